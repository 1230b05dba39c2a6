// What carries tensors on a device from process to process.
#pragma once

#include <chrono>

#include <c10/core/Device.h>
#include <torch/csrc/distributed/c10d/Backend.hpp>
#include <torch/csrc/distributed/c10d/Store.hpp>

namespace cale {

/// NCCL, for a CUDA device that no other process uses. Throws std::invalid_argument where this build has
/// none.
c10::intrusive_ptr<c10d::Backend> device_backend(const c10::intrusive_ptr<c10d::Store>& store, int rank,
                                                 int size, c10::Device device,
                                                 std::chrono::milliseconds timeout);

}  // namespace cale
