#include "patch_network.h"

#include <utility>

namespace example {
namespace {
constexpr std::int64_t kPatch = 12;
}

PatchEncoderImpl::PatchEncoderImpl(std::int64_t stack, std::int64_t height, std::int64_t width,
                                   std::int64_t channels, at::Generator generator)
    : size_(channels * (height / kPatch) * (width / kPatch)) {
    // Initial values come from the generator, not from a global one: the same seed gives the same network.
    const auto initialise = cale::glorot_uniform();
    patches_ = register_module(
        "patches", cale::Conv(stack, channels, kPatch, kPatch, initialise, generator, cale::Padding::valid));
    neighbours_ = register_module("neighbours", cale::Conv(channels, channels, std::int64_t{3},
                                                           std::int64_t{1}, initialise, generator));
}

torch::Tensor PatchEncoderImpl::forward(const torch::Tensor& observation) const {
    const auto pixels = observation.to(at::kFloat).div_(255);
    const auto tokens = patches_->forward(pixels).relu();
    return (tokens + neighbours_->forward(tokens).relu()).flatten(1);
}

PatchNetworkImpl::PatchNetworkImpl(PatchEncoder encoder, const cale::QHeadConfig& head,
                                   at::Generator generator) {
    encoder_ = register_module("encoder", std::move(encoder));
    head_ = register_module("head", cale::QHead(encoder_->size(), head, generator));
}

torch::Tensor PatchNetworkImpl::forward(const torch::Tensor& observation) {
    return head_->forward(encoder_->forward(observation)).squeeze(2);  // one atom per action
}

}  // namespace example
