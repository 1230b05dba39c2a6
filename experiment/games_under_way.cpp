#include "experiment/games_under_way.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <torch/types.h>

#include "experiment/evaluation.h"
#include "experiment/seeds.h"

namespace cale {
namespace {

std::vector<std::uint32_t> seeds(std::int64_t first, std::int64_t count, std::uint64_t seed) {
    std::vector<std::uint32_t> result;
    for (std::int64_t i = first; i < first + count; ++i)
        result.push_back(derive_seed(seed, "environment", i));
    return result;
}

EnvConfig share_of(const EnvConfig& config, const ProcessGroup& processes) {
    auto share = config;
    share.num_envs /= processes.size();
    if (share.num_envs * processes.size() == config.num_envs) return share;
    throw std::invalid_argument(fmt::format(
        "env.num_envs is {}, which {} processes cannot share equally: make it a multiple of WORLD_SIZE",
        config.num_envs, processes.size()));
}

constexpr std::int64_t kTold = 5;
/// What meet() tells of the results [steps x N]: reward, episode over, truncated, frames, event.
torch::Tensor told(std::span<const StepResult> results) {
    auto rows = torch::empty({static_cast<std::int64_t>(results.size()), kTold}, torch::kFloat32);
    auto* row = rows.data_ptr<float>();
    for (const auto& result : results) {
        *row++ = result.reward;
        *row++ = result.episode_over ? 1 : 0;
        *row++ = result.truncated ? 1 : 0;
        *row++ = static_cast<float>(result.frames);
        *row++ = static_cast<float>(result.event);
    }
    return rows;
}

StepResult result_of(const float* row) {
    return {.reward = row[0],
            .truncated = row[2] != 0,
            .episode_over = row[1] != 0,
            .event = static_cast<std::uint8_t>(row[4]),
            .frames = static_cast<int>(row[3])};
}

/// As one process with all the games would give it.
TensorMap joined(const std::vector<TensorMap>& shares) {
    TensorMap whole;
    for (const auto& share : shares) {
        for (const auto& [name, tensor] : share) {
            auto& known = whole[name];
            known =
                known.defined() ? torch::cat({known, tensor}) : tensor;  // but for game.<i>: of each share
        }
    }
    return whole;
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

GamesUnderWay::GamesUnderWay(const EnvConfig& config, std::uint64_t seed, ProcessGroup processes)
    : processes_(std::move(processes)),
      all_(config.num_envs),
      first_(all_ / processes_.size() * processes_.rank()),
      env_(share_of(config, processes_), seeds(first_, all_ / processes_.size(), seed)),
      results_(static_cast<std::size_t>(env_.size())),
      episodes_(static_cast<std::size_t>(all_)),
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
    state.step += all_;
    for (std::size_t i = 0; i < results_.size(); ++i) {
        if (results_[i].terminal || results_[i].truncated) stack_.clear(i);
        stack_.push(i, frame(frames_, i));
    }
    if (processes_.single()) {
        count_step(results_, state.step, state, ended);
    } else {
        uncounted_.insert(uncounted_.end(), results_.begin(), results_.end());
    }
}

void GamesUnderWay::meet(RunState& state, std::vector<Episode>& ended) {
    if (processes_.single()) return;
    const auto told_by_all = processes_.gather({{"results", told(uncounted_)}});
    const auto steps = static_cast<std::int64_t>(uncounted_.size() / results_.size());
    uncounted_.clear();
    if (told_by_all.empty()) return;
    std::vector<StepResult> results(static_cast<std::size_t>(all_));
    for (std::int64_t step = 0; step < steps; ++step) {
        auto* result = results.data();
        for (const auto& told_by_one : told_by_all) {
            const auto rows = told_by_one.at("results");
            for (std::int64_t i = 0; i < env_.size(); ++i)
                *result++ = result_of(rows.const_data_ptr<float>() + (step * env_.size() + i) * kTold);
        }
        count_step(results, state.step - (steps - 1 - step) * all_, state, ended);
    }
}

void GamesUnderWay::count_step(std::span<const StepResult> results, std::int64_t step, RunState& state,
                               std::vector<Episode>& ended) {
    for (const auto& result : results) {
        state.frame += result.frames;
        ++state.joystick_events[result.event];
    }
    for (std::size_t i = 0; i < results.size(); ++i) {
        const auto& result = results[i];
        auto& episode = episodes_[i];
        episode.episode_return += result.reward;
        episode.length += 1;
        if (!result.episode_over) continue;
        episode.global_step = step;
        episode.frame = state.frame;
        episode.env = static_cast<std::int64_t>(i);
        episode.truncated = result.truncated;
        ended.push_back(std::exchange(episode, {}));
    }
}

TensorMap GamesUnderWay::state() const {
    auto state = joined(processes_.gather(own_state()));
    if (!processes_.first()) return state;
    state["episode_returns"] = torch::empty({all_}, torch::kFloat64);
    state["episode_lengths"] = torch::empty({all_}, torch::kInt64);
    for (std::int64_t i = 0; i < all_; ++i) {
        const auto& episode = episodes_[static_cast<std::size_t>(i)];
        state["episode_returns"][i] = episode.episode_return;
        state["episode_lengths"][i] = episode.length;
    }
    return state;
}

TensorMap GamesUnderWay::own_state() const {
    TensorMap state{{"frames", bytes_of(frames_)}, {"stack", bytes_of(stack_.data())}};
    const auto records = env_.records();
    for (std::size_t i = 0; i < records.size(); ++i) {
        const auto name = fmt::format("game.{}.", static_cast<std::size_t>(first_) + i);
        state[name + "start"] = bytes_of(records[i].start);
        state[name + "events"] = bytes_of(records[i].events);
        state[name + "strengths"] = torch::tensor(records[i].strengths, torch::kFloat32);
    }
    return state;
}

void GamesUnderWay::restore(const TensorMap& state) {
    const auto count = results_.size();
    const auto first = static_cast<std::size_t>(first_), all = static_cast<std::size_t>(all_);
    std::vector<GameRecord> records(count);
    for (std::size_t i = 0; i < count; ++i) {
        const auto name = fmt::format("game.{}.", first + i);
        const auto start = values_of<std::uint8_t>(state, name + "start", 0);
        records[i].start.assign(start.begin(), start.end());
        for (const auto event : values_of<std::uint8_t>(state, name + "events", 0))
            records[i].events.push_back(static_cast<Event>(event));
        const auto strengths = values_of<float>(state, name + "strengths", 0);
        records[i].strengths.assign(strengths.begin(), strengths.end());
    }
    const auto of_all = frames_.size() / count * all, stack_size = stack_.data().size();
    const auto frames = values_of<std::uint8_t>(state, "frames", of_all);
    const auto stack = values_of<std::uint8_t>(state, "stack", stack_size / count * all);
    const auto returns = values_of<double>(state, "episode_returns", all);
    const auto lengths = values_of<std::int64_t>(state, "episode_lengths", all);
    env_.resume(records);
    std::ranges::copy(frames.subspan(frames_.size() / count * first, frames_.size()), frames_.begin());
    stack_.assign(stack.subspan(stack_size / count * first, stack_size));
    for (std::size_t i = 0; i < all; ++i) {
        episodes_[i].episode_return = returns[i];
        episodes_[i].length = lengths[i];
    }
}

}  // namespace cale
