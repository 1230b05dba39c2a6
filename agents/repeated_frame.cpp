#include "agents/repeated_frame.h"

#include <algorithm>

#include <torch/torch.h>

namespace cale {

void RepeatedFrame::remember(std::span<const std::uint8_t> frame, const StepResult& result) {
    previous_ = torch::empty({static_cast<std::int64_t>(frame.size())}, torch::kUInt8);
    std::copy(frame.begin(), frame.end(), previous_.data_ptr<std::uint8_t>());
    if (result.terminal || result.truncated) repeated_ = torch::Tensor();
}

void RepeatedFrame::push() {
    repeated_ = previous_;
    newer_ = 0;
}

torch::Tensor RepeatedFrame::next(const torch::Tensor& observations) {
    const auto stack = observations.size(1);
    if (!repeated_.defined() || newer_ >= stack) return observations;
    const auto split = stack - newer_++;
    const auto frame = repeated_.view({1, 1, observations.size(2), observations.size(3)});
    return torch::cat({observations.slice(1, 1, split), frame, observations.slice(1, split)}, 1);
}

}  // namespace cale
