#include "evaluate/policy_evaluation.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>
#include <torch/types.h>

#include "cale/fields.h"
#include "cale/games.h"
#include "cale/seeds.h"
#include "cale/text.h"

namespace cale {
namespace {

constexpr std::int64_t kRows = 8;

/// `forward` of `observations`, kRows of them at a time, the last ones filled up with blank ones.
template <class Forward>
torch::Tensor in_equal_batches(const torch::Tensor& observations, const Forward& forward) {
    std::vector<torch::Tensor> results;
    const std::int64_t count = observations.size(0);
    for (std::int64_t first = 0; first < count; first += kRows) {
        const std::int64_t rows = std::min(kRows, count - first);
        auto batch = observations.narrow(0, first, rows);
        if (rows < kRows) {
            auto shape = observations.sizes().vec();
            shape[0] = kRows - rows;
            batch = torch::cat({batch, torch::zeros(shape, torch::kUInt8)});
        }
        results.push_back(forward(batch).narrow(0, 0, rows));
    }
    return torch::cat(results);
}

}  // namespace

void require_playable(const PolicyInfo& policy, const EnvConfig& env) {
    for (const auto& name : split(policy.game, '+')) {
        if (std::ranges::find(all_games(), name, &Game::name) == all_games().end())
            throw std::invalid_argument(fmt::format(
                "this policy was trained in {}, which is no Atari game, and no other can be played here",
                name));
    }
    const bool continuous = env.action_space == ActionSet::continuous;
    if (continuous != (policy.action_space == "continuous")) {
        throw std::invalid_argument(
            fmt::format("this policy was trained with env.action_space={} and cannot act with {}: leave "
                        "env.action_space out",
                        policy.action_space, name_of(env.action_space)));
    }
    if (const auto joystick = coordinates(env); continuous && joystick != policy.joystick) {
        const bool paddle = joystick == Joystick::paddle || policy.joystick == Joystick::paddle;
        throw std::invalid_argument(
            fmt::format("this policy was trained with env.joystick={} and cannot act with {}: leave {} out",
                        name_of(policy.joystick), name_of(joystick), paddle ? "env.paddle" : "env.joystick"));
    }
    if (env.frame_stack != policy.stack) {
        throw std::invalid_argument(fmt::format(
            "this policy was trained with env.frame_stack={} and cannot act on {}: leave env.frame_stack out",
            policy.stack, env.frame_stack));
    }
    if (observation_space(env).frame_size() != policy.frame_height * policy.frame_width) {
        throw std::invalid_argument(
            fmt::format("this policy was trained with other observations, of {} numbers, and env.obs={}, "
                        "env.observe_joystick={} and env.frame_skip={} make ones of {}: leave env.obs, "
                        "env.observe_joystick and env.frame_skip out",
                        policy.frame_height * policy.frame_width, name_of(env.obs), env.observe_joystick,
                        env.frame_skip, observation_space(env).frame_size()));
    }
    if (continuous) return;
    const Env world(env, /*seed=*/0);
    if (std::ranges::equal(world.actions(), policy.actions)) return;
    throw std::invalid_argument(
        fmt::format("this policy chooses among {} joystick events of {}, and {} with env.action_space={} has "
                    "others: only a policy of the continuous joystick or of the full set plays other games",
                    policy.actions.size(), policy.game, env.game, name_of(env.action_space)));
}

std::string keep_life_loss(const PolicyInfo& policy, EnvConfig& env) {
    const bool asked = std::exchange(env.terminal_on_life_loss, policy.life_loss_ends_episode);
    if (asked == env.terminal_on_life_loss) return "";
    return fmt::format(
        "env.terminal_on_life_loss={} is not applied: as in this policy's training ({}), a lost life {} its "
        "frame stack; no game ends with a life",
        asked, env.terminal_on_life_loss, env.terminal_on_life_loss ? "clears" : "does not clear");
}

bool can_sample(const Policy& policy) {
    return policy.info().evaluation_samples || !policy.gives_action_values();
}

bool draws_actions(const Policy& policy, bool sampled, bool greedy) {
    return (sampled && can_sample(policy)) || (policy.info().evaluation_samples && !greedy);
}

Decide decide_by(const Policy& policy, bool sampled, std::uint64_t seed) {
    if (!sampled) {
        return [policy](const torch::Tensor& observations, std::span<const std::int64_t>) {
            if (policy.gives_action_values()) {
                const auto values = in_equal_batches(
                    observations, [&policy](const torch::Tensor& batch) { return policy.output(batch); });
                return Chosen{.actions = values.argmax(1), .values = values.amax(1)};
            }
            return Chosen{.actions = in_equal_batches(observations, [&policy](const torch::Tensor& batch) {
                              return policy.act(batch);
                          })};
        };
    }
    return [policy, seed, generators = std::map<std::int64_t, at::Generator>()](
               const torch::Tensor& observations, std::span<const std::int64_t> games) mutable {
        std::vector<torch::Tensor> actions, values;
        for (std::int64_t row = 0; row < observations.size(0); ++row) {
            const std::int64_t game = games[static_cast<std::size_t>(row)];
            auto generator = generators.find(game);
            if (generator == generators.end()) {
                const auto own = derive_seed(seed, "evaluation sample", game);
                generator = generators.emplace(game, at::detail::createCPUGenerator(own)).first;
            }
            const auto one = observations.narrow(0, row, 1);
            actions.push_back(policy.act(one, Choice::sampled, generator->second));
            if (policy.gives_action_values())
                values.push_back(policy.output(one).gather(1, actions.back().unsqueeze(1)).squeeze(1));
        }
        return Chosen{.actions = torch::cat(actions),
                      .values = values.empty() ? torch::Tensor() : torch::cat(values)};
    };
}

}  // namespace cale
