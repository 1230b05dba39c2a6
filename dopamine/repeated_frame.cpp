#include "dopamine/repeated_frame.h"

#include <algorithm>
#include <stdexcept>

#include <torch/types.h>

namespace cale {

void RepeatedFrame::remember(std::span<const std::uint8_t> frame, const StepResult& result) {
    if (result.terminal || result.truncated) {
        repeated_ = torch::Tensor();
        return;  // the reference learns of a frame when it sees the next one, which does not come
    }
    previous_ = torch::empty({static_cast<std::int64_t>(frame.size())}, torch::kUInt8);
    std::copy(frame.begin(), frame.end(), previous_.data_ptr<std::uint8_t>());
}

void RepeatedFrame::push() {
    repeated_ = previous_;
    newer_ = 0;
}

std::map<std::string, torch::Tensor> RepeatedFrame::state() const {
    const auto or_empty = [](const torch::Tensor& frame) {
        return frame.defined() ? frame.clone() : torch::empty({0}, torch::kUInt8);
    };
    return {{"previous", or_empty(previous_)},
            {"repeated", or_empty(repeated_)},
            {"newer", torch::tensor(newer_, torch::kInt64)}};
}

void RepeatedFrame::restore(const std::map<std::string, torch::Tensor>& state) {
    for (const auto* name : {"previous", "repeated", "newer"}) {
        if (!state.contains(name))
            throw std::runtime_error(std::string("the agent's state lacks 'repeated_frame/") + name + "'");
    }
    const auto require = [](bool fits, const char* name) {
        if (!fits)
            throw std::runtime_error(std::string("the agent's state has a 'repeated_frame/") + name +
                                     "' of another kind");
    };
    const auto or_none = [&](const char* name) {
        const auto& frame = state.at(name);
        require(frame.dim() == 1 && frame.scalar_type() == torch::kUInt8, name);
        return frame.numel() > 0 ? frame.clone() : torch::Tensor();
    };
    const auto& newer = state.at("newer");
    require(newer.numel() == 1 && newer.scalar_type() == torch::kInt64, "newer");
    const auto previous = or_none("previous"), repeated = or_none("repeated");
    require(!previous.defined() || !repeated.defined() || previous.numel() == repeated.numel(), "repeated");
    previous_ = previous;
    repeated_ = repeated;
    newer_ = newer.item<std::int64_t>();
}

torch::Tensor RepeatedFrame::next(const torch::Tensor& observations) {
    const auto stack = observations.size(1);
    if (!repeated_.defined() || newer_ >= stack) return observations;
    const auto split = stack - newer_++;
    auto shape = observations.sizes().vec();
    shape[0] = shape[1] = 1;
    const auto frame = repeated_.view(shape);
    return torch::cat({observations.slice(1, 1, split), frame, observations.slice(1, split)}, 1);
}

}  // namespace cale
