// Replay contents that can be read: a frame is four pixels that spell its number, 0
// being blank.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <ostream>
#include <random>
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
    config.observation = {3, {1, 4}};
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

inline Batch gather_all(const ReplayBuffer& replay) {
    std::vector<std::int64_t> positions(static_cast<std::size_t>(replay.size()));
    std::iota(positions.begin(), positions.end(), 0);
    return replay.gather(positions);
}

/// Everything stored, oldest first.
inline std::vector<NumberedTransition> read_all(const ReplayBuffer& replay) {
    return read(gather_all(replay));
}

/// With which sampling draws each of them.
inline std::vector<float> probabilities(const ReplayBuffer& replay) {
    const Batch all = gather_all(replay);
    const auto* first = all.probability.const_data_ptr<float>();
    return {first, first + replay.size()};
}

/// One endless episode: the transitions of the steps 1, 2, ..., `steps` - 1, as many as fit.
/// The number of a step is also its reward and its action.
inline ReplayBuffer filled(std::int64_t capacity, std::int64_t steps, bool prioritised = false) {
    ReplayConfig config = numbered_config();
    config.capacity = capacity;
    config.prioritised = prioritised;
    ReplayBuffer replay(config);
    for (std::int64_t t = 1; t <= steps; ++t)
        add(replay, {.frame = static_cast<std::uint32_t>(t), .reward = static_cast<float>(t), .action = t});
    return replay;
}

inline void give(ReplayBuffer& replay, const std::vector<std::int64_t>& index,
                 const std::vector<double>& priority) {
    replay.set_priorities(torch::tensor(index, torch::kInt64), torch::tensor(priority, torch::kFloat64));
}

/// Small configurations and steps at random.
class Fuzz {
  public:
    explicit Fuzz(std::uint64_t seed) : random_(seed) {}

    std::int64_t below(std::int64_t bound) {
        return static_cast<std::int64_t>(random_() % static_cast<std::uint64_t>(bound));
    }

    ReplayConfig config() {
        ReplayConfig config = numbered_config();
        config.capacity = 1 + below(40);
        config.num_envs = 1 + below(3);
        config.observation.stack = 1 + below(4);
        config.update_horizon = 1 + below(4);
        config.replay_terminal = below(2) == 0 ? ReplayTerminal::corrected : ReplayTerminal::dopamine;
        return config;
    }

    // Small rewards: with gamma 0.5 every sum is exact.
    NumberedStep step(std::int64_t mean_length, bool truncations) {
        NumberedStep made{
            .frame = ++frames_, .reward = static_cast<float>(below(9) - 4), .action = below(18)};
        if (below(mean_length) == 0) {
            made.truncated = truncations && below(2) == 0;
            made.terminal = !made.truncated;
        }
        if (made.truncated) made.final_frame = ++frames_;
        return made;
    }

  private:
    std::mt19937_64 random_;
    std::uint32_t frames_ = 0;
};

}  // namespace cale
