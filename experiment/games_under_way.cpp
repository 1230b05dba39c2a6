#include "experiment/games_under_way.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <torch/torch.h>

#include "experiment/evaluation.h"
#include "experiment/seeds.h"

namespace cale {
namespace {

std::vector<std::uint32_t> seeds(const EnvConfig& config, std::uint64_t seed) {
    std::vector<std::uint32_t> result;
    for (std::int64_t i = 0; i < config.num_envs; ++i) result.push_back(derive_seed(seed, "environment", i));
    return result;
}

std::span<const std::uint8_t> frame(const std::vector<std::uint8_t>& frames, std::size_t i) {
    return std::span(frames).subspan(i * kFrameSize, kFrameSize);
}

template <class Values>
torch::Tensor bytes_of(const Values& values) {
    static_assert(sizeof(*values.data()) == 1);
    const auto count = static_cast<std::int64_t>(values.size());
    auto bytes = torch::empty({count}, torch::kUInt8);
    std::transform(values.begin(), values.end(), bytes.data_ptr<std::uint8_t>(),
                   [](auto value) { return static_cast<std::uint8_t>(value); });
    return bytes;
}

template <class T>
std::span<const T> values_of(const TensorMap& state, const std::string& name, std::size_t count) {
    const auto found = state.find(name);
    if (found == state.end() || found->second.scalar_type() != c10::CppTypeToScalarType<T>::value ||
        !found->second.is_contiguous())
        throw std::runtime_error("the state of the games lacks '" + name + "'");
    const auto size = static_cast<std::size_t>(found->second.numel());
    if (count != 0 && size != count)
        throw std::runtime_error(
            fmt::format("the state of the games has {} values of '{}', not {}", size, name, count));
    return {found->second.const_data_ptr<T>(), size};
}

}  // namespace

GamesUnderWay::GamesUnderWay(const EnvConfig& config, std::uint64_t seed)
    : env_(config, seeds(config, seed)),
      results_(static_cast<std::size_t>(env_.size())),
      episodes_(results_.size()),
      stack_(results_.size(), kStack),
      frames_(results_.size() * kFrameSize),
      next_frames_(frames_.size()),
      final_frames_(frames_.size()) {
    env_.reset(frames_);
    for (std::size_t i = 0; i < results_.size(); ++i) stack_.push(i, frame(frames_, i));
}

torch::Tensor GamesUnderWay::observations() const {
    return stack_tensor(stack_, results_.size(), kStack);
}

void GamesUnderWay::step(const torch::Tensor& chosen) {
    const auto actions = chosen.contiguous();  // a policy's may lie column by column
    if (env_.actions().empty()) {
        static_assert(sizeof(ContinuousAction) == 3 * sizeof(float));
        env_.step(std::span(reinterpret_cast<const ContinuousAction*>(actions.const_data_ptr<float>()),
                            results_.size()),
                  next_frames_, final_frames_, results_);
    } else {
        env_.step(std::span(actions.const_data_ptr<std::int64_t>(), results_.size()), next_frames_,
                  final_frames_, results_);
    }
}

void GamesUnderWay::take_in(const torch::Tensor& actions, Agent& agent, RunState& state,
                            std::vector<Episode>& ended) {
    agent.observe(
        {.frames = frames_, .actions = actions, .results = results_, .final_frames = final_frames_});
    std::swap(frames_, next_frames_);
    state.step += env_.size();
    for (const auto& result : results_) state.frame += result.frames;
    for (std::size_t i = 0; i < results_.size(); ++i) {
        const auto& result = results_[i];
        auto& episode = episodes_[i];
        episode.episode_return += result.reward;
        episode.length += 1;
        if (result.terminal || result.truncated) stack_.clear(i);
        stack_.push(i, frame(frames_, i));
        if (!result.episode_over) continue;
        episode.global_step = state.step;
        episode.frame = state.frame;
        episode.env = static_cast<std::int64_t>(i);
        episode.truncated = result.truncated;
        ended.push_back(std::exchange(episode, {}));
    }
}

TensorMap GamesUnderWay::state() const {
    const auto count = static_cast<std::int64_t>(results_.size());
    TensorMap state{{"frames", bytes_of(frames_)}, {"stack", bytes_of(stack_.data())}};
    state["episode_returns"] = torch::empty({count}, torch::kFloat64);
    state["episode_lengths"] = torch::empty({count}, torch::kInt64);
    for (std::int64_t i = 0; i < count; ++i) {
        const auto& episode = episodes_[static_cast<std::size_t>(i)];
        state["episode_returns"][i] = episode.episode_return;
        state["episode_lengths"][i] = episode.length;
    }
    const auto records = env_.records();
    for (std::size_t i = 0; i < records.size(); ++i) {
        const auto name = fmt::format("game.{}.", i);
        state[name + "start"] = bytes_of(records[i].start);
        state[name + "events"] = bytes_of(records[i].events);
        state[name + "strengths"] = torch::tensor(records[i].strengths, torch::kFloat32);
    }
    return state;
}

void GamesUnderWay::restore(const TensorMap& state) {
    const auto count = results_.size();
    std::vector<GameRecord> records(count);
    for (std::size_t i = 0; i < count; ++i) {
        const auto name = fmt::format("game.{}.", i);
        const auto start = values_of<std::uint8_t>(state, name + "start", 0);
        records[i].start.assign(start.begin(), start.end());
        for (const auto event : values_of<std::uint8_t>(state, name + "events", 0))
            records[i].events.push_back(static_cast<Event>(event));
        const auto strengths = values_of<float>(state, name + "strengths", 0);
        records[i].strengths.assign(strengths.begin(), strengths.end());
    }
    const auto frames = values_of<std::uint8_t>(state, "frames", frames_.size());
    const auto stack = values_of<std::uint8_t>(state, "stack", stack_.data().size());
    const auto returns = values_of<double>(state, "episode_returns", count);
    const auto lengths = values_of<std::int64_t>(state, "episode_lengths", count);
    env_.resume(records);
    std::ranges::copy(frames, frames_.begin());
    stack_.assign(stack);
    for (std::size_t i = 0; i < count; ++i) {
        episodes_[i].episode_return = returns[i];
        episodes_[i].length = lengths[i];
    }
}

}  // namespace cale
