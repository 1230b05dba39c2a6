// The device that agents are tested on: the CPU, or what CALE_TEST_DEVICE names.
//   CALE_TEST_DEVICE=cuda build/bin/test_agents
#pragma once

#include <cstdlib>

#include <ATen/Context.h>
#include <torch/types.h>

namespace cale {

/// Returns `device`. From now on convolutions on a GPU keep all bits of float32 (TF32 has ten behind the
/// point).
inline torch::Device in_full_precision(torch::Device device) {
    if (device.is_cuda()) at::globalContext().setAllowTF32CuDNN(false);
    return device;
}

inline torch::Device test_device() {
    const char* wanted = std::getenv("CALE_TEST_DEVICE");
    return in_full_precision(torch::Device(wanted != nullptr ? wanted : "cpu"));
}

}  // namespace cale
