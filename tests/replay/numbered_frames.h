// Replay contents that can be read: a frame is four pixels that spell its number, 0
// being blank.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <ostream>
#include <vector>

#include "replay/replay_buffer.h"

namespace cale {

struct NumberedStep {
    std::uint32_t frame = 0;
    float reward = 0;
    bool terminal = false;
    bool truncated = false;
    std::uint32_t final_frame = 0;  // 0: none
    std::int64_t action = 0;
};

struct NumberedTransition {
    std::vector<std::uint32_t> observation;
    std::int64_t action = 0;
    float n_step_return = 0;
    float discount = 0;
    std::vector<std::uint32_t> next_observation;

    bool operator==(const NumberedTransition&) const = default;
};

inline std::ostream& operator<<(std::ostream& out, const NumberedTransition& t) {
    const auto stack = [&out](const auto& frames) {
        for (const auto frame : frames) out << ' ' << frame;
    };
    out << "{[";
    stack(t.observation);
    out << " ] a" << t.action << " R" << t.n_step_return << " g" << t.discount << " [";
    stack(t.next_observation);
    return out << " ]}";
}

/// A small buffer of numbered frames with discrete actions.
inline ReplayConfig numbered_config() {
    ReplayConfig config;
    config.capacity = 100;
    config.stack = 3;
    config.frame_height = 1;
    config.frame_width = 4;
    config.action_size = 0;
    config.gamma = 0.5;
    return config;
}

using Pixels = std::array<std::uint8_t, 4>;

inline Pixels pixels_of(std::uint32_t number) {
    Pixels pixels{};
    std::memcpy(pixels.data(), &number, sizeof number);
    return pixels;
}

inline void add(ReplayBuffer& replay, const NumberedStep& step, std::int64_t env = 0) {
    const Pixels frame = pixels_of(step.frame), final_frame = pixels_of(step.final_frame);
    Experience experience;
    experience.frame = frame;
    experience.discrete_action = step.action;
    experience.reward = step.reward;
    experience.terminal = step.terminal;
    experience.truncated = step.truncated;
    if (step.final_frame != 0) experience.final_frame = final_frame;
    replay.add(env, experience);
}

inline std::vector<NumberedTransition> read(const Batch& batch) {
    const std::int64_t size = batch.index.size(0), stack = batch.observation.size(1);
    const auto numbers = [stack](const torch::Tensor& stacks, std::int64_t row) {
        std::vector<std::uint32_t> found(static_cast<std::size_t>(stack));
        const auto bytes = sizeof(std::uint32_t) * found.size();
        std::memcpy(found.data(),
                    stacks.const_data_ptr<std::uint8_t>() + row * static_cast<std::int64_t>(bytes), bytes);
        return found;
    };
    std::vector<NumberedTransition> found;
    for (std::int64_t i = 0; i < size; ++i)
        found.push_back({numbers(batch.observation, i), batch.action[i].item<std::int64_t>(),
                         batch.n_step_return[i].item<float>(), batch.discount[i].item<float>(),
                         numbers(batch.next_observation, i)});
    return found;
}

/// Everything stored, oldest first.
inline std::vector<NumberedTransition> read_all(const ReplayBuffer& replay) {
    std::vector<std::int64_t> positions(static_cast<std::size_t>(replay.size()));
    std::iota(positions.begin(), positions.end(), 0);
    return read(replay.gather(positions));
}

}  // namespace cale
