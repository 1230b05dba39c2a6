// What the training loop knows of an algorithm.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "agents/time_split.h"
#include "networks/policy_weights.h"
#include "policy/network_spec.h"
#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

class ProcessGroup;
class Replay;

/// The world that an agent is made for.
///
/// Beside an agent's configuration there may be these functions, which the training programs call
/// (agents/on_policy.h has all of them):
///   check_settings(config, spec)           Throws std::invalid_argument, in one sentence, where settings do
///                                          not fit together or to this world. make_NAME() calls it too. Is
///                                          called before there is a game: a discrete action_space may have
///                                          any number of actions.
///   schedule_over_run(config)              Returns the key of the setting by which a schedule lasts for the
///                                          whole run, so that another train.total_steps changes it, or "".
///   check_memory(config, spec, available)  Throws std::runtime_error unless the agent fits into so many
///                                          bytes once its replay or rollout is full.
struct AgentSpec {
    std::int64_t num_envs = 1;                    // of this process
    ActionSpace action_space = joystick_space();  // of the world
    ObservationSpace observation = {};            // what the agent sees
    std::int64_t total_steps = 0;        // agent steps of the whole run, for schedules that end with it
    bool overlap = false;                // the environments step while the agent learns
    std::uint64_t seed = 1;              // all that is random in the agent follows from it
    torch::Device device = torch::kCPU;  // where the networks are
    /// That train this agent together, each with num_envs environments. Null: this one alone.
    const ProcessGroup* processes = nullptr;
};

/// Throw std::invalid_argument that says which action_space the agent called `who` needs, if it is not
/// that of the world.
void require_continuous(std::string_view who, const AgentSpec& spec);
/// See require_continuous().
void require_discrete(std::string_view who, const AgentSpec& spec);

/// Adds charts/mean_<name> of each coordinate of an action [A] of a box, such as charts/mean_radius.
void add_mean_action(std::map<std::string, double>& metrics, const ActionSpace& space,
                     const torch::Tensor& action);

/// One agent step of N environments. The spans need to live only during the call.
struct StepBatch {
    std::span<const std::uint8_t> frames;        // N newest frames: those the actions were chosen on
    torch::Tensor actions;                       // what act() returned
    std::span<const StepResult> results;         // N
    std::span<const std::uint8_t> final_frames;  // N, valid where an episode is over
};

/// Returns the shape of an observation: [stack, rows, columns], or [stack, bytes] where it is no image.
std::vector<std::int64_t> observation_shape(const AgentSpec& spec);

/// What is stored of an agent so that others can act as it does in its evaluations: docs/policy_file.md.
struct AgentPolicy {
    NetworkSpec network;   // the half that acts
    TensorMap weights;     // by the names of parameter_shapes(network), float32 on the CPU
    bool samples = false;  // draws its actions from the policy, instead of taking the best one
    double epsilon = 0;    // probability of a uniform action
};

/// Returns that of a network with a member `acting`, such as SacNetwork.
template <class Network>
AgentPolicy policy_of_network(const Network& network, bool samples, double epsilon) {
    return {network->acting, policy_weights(network->acting, *network), samples, epsilon};
}

/// With the noise of training, or as evaluations do it.
enum class ActMode { train, evaluate };

/// The order of calls, in the paper's strict rhythm:  update, act, (environment), observe.
class Agent {
  public:
    virtual ~Agent() = default;

    /// Chooses one action for each observation [N, stack, H, W] uint8: [N, 3] float32, or [N] int64.
    virtual torch::Tensor act(const torch::Tensor& observations, ActMode mode) = 0;

    /// Records what followed. Called once per agent step.
    virtual void observe(const StepBatch& batch) = 0;

    /// Called once before every decision with the observations that it will be made on: the agent
    /// updates itself when its own rhythm says so. Returns whether it did.
    virtual bool update(const torch::Tensor& observations) = 0;

    /// What of the time inside update() and observe() was the replay's: its parts `replay` and `transfer`.
    virtual TimeSplit memory_time() const { return {}; }

    /// Named scalars of the newest update and the current schedules: name -> value,
    /// tagged as TensorBoard shows them ("losses/qf_loss"). Waits for the device.
    virtual std::map<std::string, double> metrics() = 0;

    /// Everything that the future of this agent depends on but for the replay's contents; a rollout under way
    /// is part of it. All processes of a run call it together, and what the first one gets is that of all.
    virtual TensorMap state() = 0;
    /// Throws std::runtime_error, and changes nothing, for the state of another agent or configuration.
    virtual void load_state(const TensorMap& state) = 0;
    /// Returns the policy as it is now, for the policy file of a checkpoint; none: this agent cannot be
    /// exported.
    virtual std::optional<AgentPolicy> policy() const { return std::nullopt; }
    /// The replay that it learns from, whose contents a checkpoint holds beside state(); null where it has
    /// none.
    virtual Replay* replay() { return nullptr; }
};

}  // namespace cale
