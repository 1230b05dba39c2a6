#include "train/collector.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <torch/types.h>

#include "cale/seeds.h"
#include "evaluate/evaluation.h"

namespace cale {
namespace {

std::vector<std::uint32_t> seeds(std::int64_t first, std::int64_t count, std::uint64_t seed) {
    std::vector<std::uint32_t> result;
    for (std::int64_t i = first; i < first + count; ++i)
        result.push_back(derive_seed(seed, "environment", i));
    return result;
}

std::int64_t share_of(std::int64_t num_envs, const ProcessGroup& processes) {
    const auto share = num_envs / processes.size();
    if (share * processes.size() == num_envs) return share;
    throw std::invalid_argument(fmt::format(
        "env.num_envs is {}, which {} processes cannot share equally: make it a multiple of WORLD_SIZE",
        num_envs, processes.size()));
}

constexpr std::int64_t kPacked = 5, kFrameEvents = std::tuple_size_v<decltype(StepResult::frame_events)>;
/// Results [steps x N] as numbers: reward, episode over, truncated, frames, event; and, where the stick
/// moves, the events of the frames.
torch::Tensor packed(std::span<const StepResult> results) {
    const bool stick_moves = !results.empty() && results.front().stick_moves;
    auto rows =
        torch::empty({static_cast<std::int64_t>(results.size()), kPacked + (stick_moves ? kFrameEvents : 0)},
                     torch::kFloat32);
    auto* row = rows.data_ptr<float>();
    for (const auto& result : results) {
        *row++ = result.reward;
        *row++ = result.episode_over ? 1 : 0;
        *row++ = result.truncated ? 1 : 0;
        *row++ = static_cast<float>(result.frames);
        *row++ = static_cast<float>(result.event);
        if (stick_moves) row = std::ranges::copy(result.frame_events, row).out;
    }
    return rows;
}

/// Row `i` of what packed() returned.
StepResult unpacked(const torch::Tensor& rows, std::int64_t i) {
    const auto* const row = rows.const_data_ptr<float>() + i * rows.size(1);
    StepResult result{.reward = row[0],
                      .truncated = row[2] != 0,
                      .episode_over = row[1] != 0,
                      .frames = static_cast<int>(row[3]),
                      .event = static_cast<std::uint8_t>(row[4]),
                      .stick_moves = rows.size(1) > kPacked};
    if (result.stick_moves) {
        std::ranges::transform(std::span(row + kPacked, result.frame_events.size()),
                               result.frame_events.begin(),
                               [](float event) { return static_cast<std::uint8_t>(event); });
    }
    return result;
}

/// As one process with all the games would give it.
TensorMap joined(const std::vector<TensorMap>& shares) {
    TensorMap whole;
    for (const auto& share : shares) {
        for (const auto& [name, tensor] : share) {
            auto& known = whole[name];  // none yet of game.<i>, which is in one share
            known = known.defined() ? torch::cat({known, tensor}) : tensor;
        }
    }
    return whole;
}

torch::Tensor byte_tensor(std::span<const std::uint8_t> bytes) {
    auto tensor = torch::empty({std::ssize(bytes)}, torch::kUInt8);
    std::ranges::copy(bytes, tensor.data_ptr<std::uint8_t>());
    return tensor;
}

template <class T>
std::span<const T> stored_values(const TensorMap& state, const std::string& name, std::size_t count) {
    const auto found = state.find(name);
    if (found == state.end() || found->second.scalar_type() != c10::CppTypeToScalarType<T>::value ||
        !found->second.is_contiguous())
        throw std::runtime_error("the state of the games lacks '" + name + "'");
    const auto size = static_cast<std::size_t>(found->second.numel());
    if (size != count)
        throw std::runtime_error(
            fmt::format("the state of the games has {} values of '{}', not {}", size, name, count));
    return {found->second.const_data_ptr<T>(), size};
}

/// Throws for ends that contradict each other: the frame stack and the replay would run on into another
/// episode.
void require_ends(std::span<const StepResult> results, std::int64_t first) {
    for (std::size_t i = 0; i < results.size(); ++i) {
        const auto& result = results[i];
        const auto number = first + static_cast<std::int64_t>(i);
        if (result.episode_over && !result.terminal && !result.truncated)
            throw std::invalid_argument(fmt::format(
                "a step of environment {} has episode_over, but neither terminal nor truncated", number));
        if (result.truncated && !result.episode_over)
            throw std::invalid_argument(
                fmt::format("a step of environment {} is truncated, but has no episode_over", number));
    }
}

}  // namespace

Collector::Collector(const MakeWorld& make_world, std::int64_t num_envs, std::uint64_t seed,
                     ProcessGroup processes)
    : processes_(std::move(processes)),
      all_(num_envs),
      first_(share_of(num_envs, processes_) * processes_.rank()),
      world_(make_world(seeds(first_, share_of(num_envs, processes_), seed))),
      observation_space_(world_->observation_space()),
      frame_size_(static_cast<std::size_t>(observation_space_.frame_size())),
      results_(static_cast<std::size_t>(world_->size())),
      episodes_(static_cast<std::size_t>(all_)),
      stack_(results_.size(), static_cast<std::size_t>(observation_space_.stack), frame_size_),
      frames_(results_.size() * frame_size_),
      next_frames_(frames_.size()),
      final_frames_(frames_.size()) {
    world_->reset(frames_);
    for (std::size_t i = 0; i < results_.size(); ++i) stack_.push(i, frame(i));
}

torch::Tensor Collector::observations() const {
    return stack_tensor(stack_, results_.size(), observation_space_);
}

void Collector::step(const torch::Tensor& actions) {
    const auto rows = actions.contiguous();  // a policy's may lie column by column
    world_->step(view_of_actions(rows), next_frames_, final_frames_, results_);
    require_ends(results_, first_);
}

void Collector::announce(const torch::Tensor& actions) {
    const auto rows = actions.contiguous();
    world_->announce(view_of_actions(rows));
}

void Collector::record(const torch::Tensor& actions, Agent& agent, RunState& state,
                       std::vector<Episode>& ended) {
    agent.observe(
        {.frames = frames_, .actions = actions, .results = results_, .final_frames = final_frames_});
    std::swap(frames_, next_frames_);
    state.step += all_;
    for (std::size_t i = 0; i < results_.size(); ++i) stack_.follow(i, results_[i], frame(i));
    if (processes_.single()) {
        count_step(results_, state.step, state, ended);
    } else {
        uncounted_.insert(uncounted_.end(), results_.begin(), results_.end());
    }
}

void Collector::synchronise(RunState& state, std::vector<Episode>& ended) {
    if (processes_.single()) return;
    const auto gathered = processes_.gather({{"results", packed(uncounted_)}});
    const auto steps = static_cast<std::int64_t>(uncounted_.size() / results_.size());
    uncounted_.clear();
    if (gathered.empty()) return;
    std::vector<StepResult> results(static_cast<std::size_t>(all_));
    for (std::int64_t step = 0; step < steps; ++step) {
        auto* result = results.data();
        for (const auto& share : gathered) {
            const auto rows = share.at("results");
            for (std::int64_t i = 0; i < world_->size(); ++i)
                *result++ = unpacked(rows, step * world_->size() + i);
        }
        count_step(results, state.step - (steps - 1 - step) * all_, state, ended);
    }
}

void Collector::count_step(std::span<const StepResult> results, std::int64_t step, RunState& state,
                           std::vector<Episode>& ended) {
    for (const auto& result : results) {
        state.frame += result.frames;
        count_events(state.joystick_events, result);
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

TensorMap Collector::state() const {
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

TensorMap Collector::own_state() const {
    TensorMap state{{"frames", byte_tensor(frames_)}, {"stack", byte_tensor(stack_.data())}};
    const auto records = world_->record();
    for (std::size_t i = 0; i < records.size(); ++i) {
        for (const auto& [name, bytes] : records[i])
            state[fmt::format("game.{}.{}", static_cast<std::size_t>(first_) + i, name)] = byte_tensor(bytes);
    }
    return state;
}

void Collector::restore(const TensorMap& state) {
    const auto count = results_.size();
    const auto first = static_cast<std::size_t>(first_), all = static_cast<std::size_t>(all_);
    std::vector<EpisodeRecord> records(count);
    const auto present = world_->record();  // has the same names
    for (std::size_t i = 0; i < count; ++i) {
        for (const auto& [name, bytes_now] : present[i]) {
            const auto key = fmt::format("game.{}.{}", first + i, name);
            const auto found = state.find(key);
            if (found == state.end()) throw std::runtime_error("the state of the games lacks '" + key + "'");
            const auto tensor = found->second.contiguous();  // of numbers in checkpoints of earlier versions
            const auto* const bytes = static_cast<const std::uint8_t*>(tensor.const_data_ptr());
            records[i][name].assign(bytes, bytes + tensor.nbytes());
        }
    }
    const auto stack_size = stack_.data().size() / count;  // of an environment
    const auto frames = stored_values<std::uint8_t>(state, "frames", frame_size_ * all);
    const auto stack = stored_values<std::uint8_t>(state, "stack", stack_size * all);
    const auto returns = stored_values<double>(state, "episode_returns", all);
    const auto lengths = stored_values<std::int64_t>(state, "episode_lengths", all);
    world_->resume(records);
    std::ranges::copy(frames.subspan(frame_size_ * first, frames_.size()), frames_.begin());
    final_frames_ = frames_;  // the last one of a game that its world cannot continue
    stack_.assign(stack.subspan(stack_size * first, stack_size * count));
    for (std::size_t i = 0; i < all; ++i) {
        episodes_[i].episode_return = returns[i];
        episodes_[i].length = lengths[i];
    }
}

}  // namespace cale
