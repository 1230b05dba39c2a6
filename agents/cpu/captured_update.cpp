// For a LibTorch without CUDA: see agents/cuda/captured_update.cpp.
#include "agents/captured_update.h"

namespace cale {

struct CapturedUpdate::Impl {};

CapturedUpdate::CapturedUpdate(c10::Device, at::Generator) {}
CapturedUpdate::~CapturedUpdate() = default;

void CapturedUpdate::operator()(const std::function<void()>& update) {
    update();
}
void CapturedUpdate::forget() {}

}  // namespace cale
