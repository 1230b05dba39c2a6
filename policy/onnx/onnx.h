// A policy as an ONNX model, for the runtimes that read those.
#pragma once

#include <string>

#include "policy/policy_file.h"

namespace cale {

/// The bytes of the model (ONNX IR 8, operators of version 17). Input "observation" [N, stack, H, W] uint8,
/// of memory [N, stack, bytes]; outputs "action", the greedy one: [N, coordinates] float32 or [N] int64, and
/// "output" [N, output_size] float32 as Policy::output. The model leaves out the noise of noisy layers. The
/// policy's metadata are its own. Throws std::runtime_error for a policy of 2 GB and more, which ONNX cannot
/// hold.
std::string onnx_model(const PolicyFile& policy);

}  // namespace cale
