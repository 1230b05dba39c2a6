// For a LibTorch without CUDA: see parallel/cuda/device_backend.cpp.
#include "parallel/device_backend.h"

#include <stdexcept>

namespace cale {

c10::intrusive_ptr<c10d::Backend> device_backend(const c10::intrusive_ptr<c10d::Store>&, int, int,
                                                 c10::Device device, std::chrono::milliseconds) {
    throw std::invalid_argument("several processes on " + device.str() +
                                " need a build with NCCL: scripts/setup --cuda, then configure again");
}

}  // namespace cale
