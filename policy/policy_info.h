// The description of a trained policy, shared by cale::Policy (with LibTorch) and cale::lite::Policy
// (without).
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cale/action.h"
#include "cale/joystick.h"

namespace cale {

/// All but the weights. The texts of docs/policy_file.md say how it is stored.
struct PolicyInfo {
    std::string game;          // "Breakout", as in "ALE/Breakout-v5"
    std::string agent;         // the algorithm: "sac", "sacd", "ppo", "dqn", "der", or a custom agent
    std::string encoder;       // agent.encoder, such as "phi_sac"; empty where the agent has no such setting
    std::string action_space;  // "continuous", "minimal" or "full", as env.action_space

    /// What action number i presses; empty: an action is a vector of coordinates of the joystick.
    std::vector<Event> actions;
    /// Of the continuous joystick: the coordinates that the network chooses.
    Joystick joystick = Joystick::polar;
    double threshold = 0.5;                    // env.threshold
    EventMap event_map = EventMap::symmetric;  // from action to joystick event: env.event_map
    /// Whether r scales how far a paddle moves (env.paddle_strength: radius).
    bool radius_is_strength = false;

    /// An observation: the last `stack` frames, newest last, of frame_height x frame_width bytes. Where it is
    /// the console's memory and no frame, frame_height is 1.
    std::int64_t stack = 4;
    std::int64_t frame_height = 84;  // rows
    std::int64_t frame_width = 84;   // columns
    /// Emulated frames per decision.
    std::int64_t frame_skip = 4;
    /// Whether the stack restarts at a lost life too (Atari 100k), not only with a game.
    bool life_loss_ends_episode = false;

    /// How the run's own evaluations act: as Choice::sampled, else greedily; and by a uniformly random action
    /// with probability `epsilon`.
    bool evaluation_samples = false;
    double epsilon = 0;  // 0 to 1

    /// Where it comes from, name -> text: seed, agent_steps, frames, cale, ale, libtorch, config (the run's
    /// whole configuration as YAML).
    std::map<std::string, std::string> provenance;

    /// Actions to choose from; 0: the joystick's coordinates.
    std::int64_t num_actions() const { return static_cast<std::int64_t>(actions.size()); }
    /// Bytes of an observation.
    std::size_t observation_size() const {
        return static_cast<std::size_t>(stack * frame_height * frame_width);
    }
};

/// Sets the shape of an observation in `info`. Must be [stack, rows, columns] or [stack, bytes].
void set_observation(PolicyInfo& info, const std::vector<std::int64_t>& shape);
/// Returns that shape.
std::vector<std::int64_t> observation_shape(const PolicyInfo& info);

/// Returns whether an agent may have this name, which is a part of files' names: at most 64 letters, digits,
/// '_' and '-'.
bool is_agent_name(std::string_view name);

/// How an action is chosen.
///   greedy        the mean action of a Gaussian, the likeliest or most valuable of a set
///   sampled       drawn from the policy; the best of action values (DQN, DER), which are no distribution,
///                 after a draw of the noise where layers are noisy
///   as_evaluated  as the run's own evaluations do it: see PolicyInfo::evaluation_samples and epsilon
enum class Choice { greedy, sampled, as_evaluated };

/// Returns whether the policy draws its actions, or its weights' noise, where it chooses so.
bool draws(const PolicyInfo& info, Choice choice);

/// One decision, and the joystick event that it stands for.
struct Decision {
    ContinuousAction stick{};   // of the continuous joystick
    std::int64_t action = -1;   // number among PolicyInfo::actions; -1: coordinates
    Event event = Event::noop;  // to press
    float strength = 1;         // how far a paddle moves, 0 to 1
    /// Where a paddle is to be, from its left end, 0, to its right one, 1, instead of the event's direction;
    /// none but of a policy that places it (Joystick::paddle).
    std::optional<float> paddle{};
};

/// Returns the decision that this position of the joystick is in the policy's game.
Decision decision(const PolicyInfo& info, const ContinuousAction& stick);
/// Throws std::out_of_range for a number that the policy has no action for.
Decision decision(const PolicyInfo& info, std::int64_t action);

}  // namespace cale
