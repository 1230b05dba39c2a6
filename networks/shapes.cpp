#include "networks/shapes.h"

#include <stdexcept>

#include <torch/types.h>

namespace cale {

std::string shape_text(at::IntArrayRef shape) {
    std::string text = "[";
    for (const auto size : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(size);
    return text + "]";
}

void require_shape(std::string_view who, std::string_view what, const torch::Tensor& tensor,
                   at::IntArrayRef expected) {
    if (tensor.defined() && tensor.sizes() == expected) return;
    throw std::invalid_argument(std::string(who) + ": " + std::string(what) + " must have the shape " +
                                shape_text(expected) + ", not " +
                                (tensor.defined() ? shape_text(tensor.sizes()) : "none at all"));
}

}  // namespace cale
