// The interface between the training loop and an algorithm: the class Agent, and functions that a
// configuration may have beside it. The training programs call these (agents/on_policy.h and
// on_policy_memory.h have all of them):
//   check_settings(config, spec)           Throws std::invalid_argument, in one sentence, where settings do
//                                          not fit together or to this world. make_NAME() calls it too. Is
//                                          called before there is a game: a discrete action_space may have
//                                          any number of actions.
//   schedule_over_run(config)              Returns the key of the setting by which a schedule lasts for the
//                                          whole run, so that another train.total_steps changes it, or "".
//   check_memory(config, spec, available)  Throws std::runtime_error unless the agent fits into so many
//                                          bytes once its replay or rollout is full.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include <torch/types.h>

#include "agents/time_split.h"
#include "networks/layers.h"
#include "policy/network_spec.h"
#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

class ProcessGroup;
class Replay;

/// The world that an agent is made for.
struct AgentSpec {
    std::int64_t num_envs = 1;                    // of this process
    ActionSpace action_space = joystick_space();  // of the world
    ObservationSpace observation = {};            // what the agent sees
    std::int64_t total_steps = 0;              // agent steps of the whole run, for schedules that end with it
    bool overlap = false;                      // the environments step while the agent learns
    std::uint64_t seed = 1;                    // seeds all randomness of the agent
    torch::Device device = torch::kCPU;        // where the networks are
    Precision precision = Precision::float32;  // of convolutions and products
    /// The processes that train this agent together, each with num_envs environments. Null: a single process.
    const ProcessGroup* processes = nullptr;
};

/// Throws std::invalid_argument unless the world has the action space that the agent called `who` needs.
void require_continuous(std::string_view who, const AgentSpec& spec);
/// See require_continuous().
void require_discrete(std::string_view who, const AgentSpec& spec);

/// Adds charts/mean_<name> of each coordinate of an action [A] of a box, such as charts/mean_radius.
void add_mean_action(std::map<std::string, double>& metrics, const ActionSpace& space,
                     const torch::Tensor& action);

/// One agent step of N environments. The spans must be valid only during the call.
struct StepBatch {
    std::span<const std::uint8_t> frames;        // N newest frames: those the actions were chosen on
    torch::Tensor actions;                       // what act() returned
    std::span<const StepResult> results;         // N
    std::span<const std::uint8_t> final_frames;  // N, valid where an episode is over
};

/// What a policy file stores of an agent, to act as its evaluations do in float32: docs/policy_file.md.
struct AgentPolicy {
    NetworkSpec network;   // the half that acts
    TensorMap weights;     // by the names of parameter_shapes(network), float32 on the CPU
    bool samples = false;  // draws actions or noise (Choice::sampled), instead of taking the best action
    double epsilon = 0;    // probability of a uniform action
};

/// Returns the policy of a network, of which `acting` is the half that acts, with its weights as they are now
/// (networks/policy_weights.h).
AgentPolicy policy_of(const NetworkSpec& acting, const torch::nn::Module& network, bool samples,
                      double epsilon);
/// Returns the policy of a network with a member `acting`, such as SacNetwork.
template <class Network>
AgentPolicy policy_of(const Network& network, bool samples, double epsilon) {
    return policy_of(network->acting, *network, samples, epsilon);
}

/// A number of an agent is not finite. Training from the newest checkpoint would fail in the same way again
/// (on a CPU).
struct Diverged : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Throws Diverged, which calls the numbers `what`, where one of them is not finite.
void require_finite(const torch::Tensor& numbers, std::string_view what = "the actor's output");

/// With exploration (train), or as in evaluations (evaluate).
enum class ActMode { train, evaluate };

/// The order of calls, as in the paper: update, act, (environment step), observe. With train.overlap or
/// train.realtime it is act, update, observe. Agents that learn beside the environments keep the first order;
/// other agents without a replay are refused (train/program.h).
class Agent {
  public:
    virtual ~Agent() = default;

    /// Returns one action for each observation [N, stack, ...] uint8: [N, A] float32, or [N] int64. Throws
    /// Diverged where none can be chosen.
    virtual torch::Tensor act(const torch::Tensor& observations, ActMode mode) = 0;

    /// Records the outcome of the actions. Called once per agent step.
    virtual void observe(const StepBatch& batch) = 0;

    /// Updates the agent if an update is due. Called once for every decision, with the observations that it
    /// is made on. Returns whether an update was made.
    virtual bool update(const torch::Tensor& observations) = 0;

    /// Returns the time that update() and observe() spent in the replay: the parts `replay` and `transfer`.
    virtual TimeSplit memory_time() const { return {}; }

    /// Named scalars of the newest update and the current schedules: name -> value,
    /// tagged as TensorBoard shows them ("losses/qf_loss"). A tag that begins with "losses/" is there only
    /// once an update was made since the agent was constructed or loaded: until then a resumed run logs those
    /// of its checkpoint. Waits for the device.
    virtual std::map<std::string, double> metrics() = 0;

    /// Returns the agent's complete state except for the replay's contents; an unfinished rollout is
    /// included. All processes of a run must call it together; the first one receives the state of all.
    virtual TensorMap state() = 0;
    /// Throws std::runtime_error, and changes nothing, for the state of another agent or configuration.
    virtual void load_state(const TensorMap& state) = 0;
    /// Returns the current policy, for the policy file of a checkpoint; nullopt if this agent cannot be
    /// exported.
    virtual std::optional<AgentPolicy> policy() const { return std::nullopt; }
    /// Returns the agent's replay, whose contents a checkpoint stores beside state(); null if it has none.
    virtual Replay* replay() { return nullptr; }
};

}  // namespace cale
