#include "patch_network.h"

namespace example {

cale::Layers patch_layers(std::int64_t channels) {
    using Kind = cale::Layer::Kind;
    constexpr std::int64_t patch = 12;
    return {cale::Layer::conv("patches", channels, patch, patch, cale::Padding::valid),
            cale::Layer::of(Kind::relu),
            cale::Layer::of(Kind::keep),
            cale::Layer::conv("neighbours", channels, 3, 1),
            cale::Layer::of(Kind::relu),
            cale::Layer::of(Kind::add_kept),
            cale::Layer::of(Kind::flatten)};
}

// Initial values come from the generator, not from a global one: the same seed gives the same network.
PatchEncoderImpl::PatchEncoderImpl(const std::vector<std::int64_t>& observation, std::int64_t channels,
                                   const at::Generator& generator)
    : stack_(*this, patch_layers(channels), observation, cale::glorot_uniform(), generator) {}

PatchNetworkImpl::PatchNetworkImpl(const std::vector<std::int64_t>& observation, std::int64_t channels,
                                   const cale::QHeadConfig& head, const at::Generator& generator)
    : acting(cale::values_spec(observation, patch_layers(channels), head)) {
    encoder_ = register_module("encoder", PatchEncoder(observation, channels, generator));
    head_ = register_module("head", cale::QHead(encoder_->size(), head, generator));
}

torch::Tensor PatchNetworkImpl::forward(const torch::Tensor& observation) {
    return head_->forward(encoder_->forward(observation)).squeeze(2);  // one atom per action
}

}  // namespace example
