#include "agents/off_policy.h"

#include <algorithm>
#include <array>
#include <stdexcept>

#include <c10/core/impl/VirtualGuardImpl.h>
#include <torch/types.h>

#include "agents/random.h"
#include "networks/layers.h"
#include "replay/types.h"

namespace cale {
namespace {

constexpr std::array kDeviceParts{&Batch::observation, &Batch::action,           &Batch::n_step_return,
                                  &Batch::discount,    &Batch::next_observation, &Batch::probability};

/// The random streams of an agent. Their numbers are part of a run: another number is another seed. Where
/// updates draw nothing, evaluation has their number.
enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kUpdates, kEvaluation };

}  // namespace

ReplayConfig replay_config(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised) {
    return {.capacity = settings.replay_capacity,
            .num_envs = spec.num_envs,
            .observation = spec.observation,
            .action_size = box_size(spec.action_space),
            .update_horizon = settings.update_horizon,
            .gamma = settings.gamma,
            .replay_terminal = settings.replay_terminal,
            .prioritised = prioritised};
}

AgentReplay::AgentReplay(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised)
    : settings_(settings),
      spec_(spec),
      buffer_(make_replay(replay_config(settings, spec, prioritised),
                          settings.replay_on_device ? std::optional(spec.device) : std::nullopt)),
      sampled_(buffer_->empty_batch(settings.batch_size)),
      copied_(spec.device.type()),
      random_(stream_seed(spec.seed, kReplay)) {
    if (spec.device.is_cpu()) return;
    on_device_ = sampled_;  // `index` stays where it is
    for (const auto part : kDeviceParts) {
        if (!(sampled_.*part).is_cpu()) continue;  // made there
        sampled_.*part = (sampled_.*part).pin_memory();
        on_device_.*part = torch::empty_like(sampled_.*part, spec.device);
    }
}

void AgentReplay::record(const StepBatch& batch) {
    const Timed timed(time_.replay);
    const auto frame_size = static_cast<std::size_t>(spec_.observation.frame_size());
    const auto count = static_cast<std::size_t>(spec_.num_envs);
    const auto action_size = box_size(spec_.action_space);
    const bool continuous = action_size > 0;
    const auto actions =
        batch.actions.to(torch::kCPU, continuous ? torch::kFloat32 : torch::kInt64).contiguous();
    const auto require = [&](const std::string& what, std::int64_t given, std::int64_t each) {
        if (given != spec_.num_envs * each)
            throw std::invalid_argument("the replay expects the " + what + " of " + std::to_string(count) +
                                        " environments, not " + std::to_string(given));
    };
    require("results", std::ssize(batch.results), 1);
    require("bytes of frames", std::ssize(batch.frames), spec_.observation.frame_size());
    require("numbers of actions", actions.numel(), std::max<std::int64_t>(action_size, 1));
    require_finite_rewards(batch.results);
    const auto limit = static_cast<float>(settings_.reward_clip.value_or(INFINITY));
    for (std::size_t env = 0; env < count; ++env) {
        const auto& result = batch.results[env];
        // Frames that are not there are left for the replay to refuse.
        const auto frame_of = [&](std::span<const std::uint8_t> frames) {
            return frames.size() == count * frame_size ? frames.subspan(env * frame_size, frame_size)
                                                       : std::span<const std::uint8_t>();
        };
        Experience experience{.frame = frame_of(batch.frames),
                              .reward = std::clamp(result.reward, -limit, limit),
                              .terminal = result.terminal,
                              .truncated = result.truncated};
        if (continuous) {
            experience.action = {
                actions.const_data_ptr<float>() + env * static_cast<std::size_t>(action_size),
                static_cast<std::size_t>(action_size)};
        } else {
            experience.discrete_action = actions.const_data_ptr<std::int64_t>()[env];
        }
        if (result.truncated) experience.final_frame = frame_of(batch.final_frames);
        buffer_->add(static_cast<std::int64_t>(env), experience);
    }
}

std::int64_t AgentReplay::due(std::int64_t period) const {
    const auto multiples_below = [period](std::int64_t number) { return (number + period - 1) / period; };
    return multiples_below(decisions_) - multiples_below(decisions_ - spec_.num_envs);
}

bool AgentReplay::ready() const {
    return buffer_->add_count() > settings_.min_replay && buffer_->size() > 0;
}

double AgentReplay::epsilon(const EpsilonSettings& settings) const {
    return linearly_decaying_epsilon(settings.epsilon_decay_period, decisions_, settings_.min_replay,
                                     settings.epsilon_train);
}

Batch AgentReplay::sample() {
    // The copy of the batch before this one must be done; what the device learns from it may go on.
    if (copied_.was_marked_for_recording()) copied_.synchronize();
    {
        const Timed timed(time_.replay);
        buffer_->sample_into(sampled_, random_);
    }
    if (spec_.device.is_cpu()) return sampled_;
    const Timed timed(time_.transfer);
    for (const auto part : kDeviceParts) {
        if ((sampled_.*part).is_cpu()) (on_device_.*part).copy_(sampled_.*part, /*non_blocking=*/true);
    }
    copied_.record(c10::impl::VirtualGuardImpl(spec_.device.type()).getStream(spec_.device));
    return on_device_;
}

void AgentReplay::set_priorities(const Batch& batch, const torch::Tensor& priorities) {
    const auto on_host = priorities.to(torch::kCPU);  // waits for the device
    require_finite(on_host, "a transition's priority");
    const Timed timed(time_.replay);
    buffer_->set_priorities(batch.index, on_host);
}

void AgentReplay::add_state(StateParts& parts) {
    parts.engines["random/replay"] = &random_;
    parts.counters["training_steps"] = &decisions_;
}

void require_batch_shapes(std::string_view who, const Batch& batch, at::IntArrayRef action) {
    const auto size = batch.observation.size(0);
    require_shape(who, "the action", batch.action, action);
    require_shape(who, "the n-step return", batch.n_step_return, {size});
    require_shape(who, "the discount", batch.discount, {size});
    require_shape(who, "the next observation", batch.next_observation, batch.observation.sizes());
}

torch::Tensor n_step_target(const Batch& batch, const torch::Tensor& next_value, double reward_scale) {
    const auto of_state = [&](const torch::Tensor& x) {
        const auto typed = x.to(next_value.scalar_type());
        return next_value.dim() == 2 ? typed.unsqueeze(1) : typed;
    };
    return reward_scale * of_state(batch.n_step_return) + of_state(batch.discount) * next_value;
}

void check_random_shift(const ReplaySettings& settings, const AgentSpec& spec) {
    if (settings.random_shift == 0 || spec.observation.shape.size() == 2) return;
    throw std::invalid_argument(
        "agent.random_shift moves images, and this world's observations are none: set it to 0, or env.obs to "
        "pixels");
}

at::Generator initial_values(const AgentSpec& spec) {
    return make_generator(stream_seed(spec.seed, kInitialValues));
}

RandomStreams::RandomStreams(const AgentSpec& spec, bool draws_in_updates)
    : acting(make_generator(stream_seed(spec.seed, kActing))),
      evaluation(make_generator(stream_seed(spec.seed, draws_in_updates ? kEvaluation : kUpdates))) {
    if (draws_in_updates) updates = make_generator(stream_seed(spec.seed, kUpdates), spec.device);
}

void RandomStreams::add_state(StateParts& parts) {
    parts.generators["random/acting"] = &acting;
    parts.generators["random/evaluation"] = &evaluation;
    if (updates.defined()) parts.generators["random/update_noise"] = &updates;
}

}  // namespace cale
