// Shapes are checked where tensors enter: [B] against [B, 1] would broadcast in silence.
#pragma once

#include <string>
#include <string_view>

#include <torch/types.h>

namespace cale {

/// "[32, 4, 84, 84]"
std::string shape_text(at::IntArrayRef shape);

/// Throws std::invalid_argument that names `who` was given `what` in which shape, and which one it expects.
void require_shape(std::string_view who, std::string_view what, const torch::Tensor& tensor,
                   at::IntArrayRef expected);

}  // namespace cale
