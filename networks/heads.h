// The networks on an encoder's features: multilayer perceptrons, twin critics, and the tanh-squashed Gaussian
// policy on a box (Haarnoja et al. 2018, "Soft Actor-Critic", appendix C). Then epsilon-greedy actions.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/layer_stack.h"
#include "networks/layers.h"
#include "policy/network_spec.h"
#include "world/spaces.h"

namespace cale {

/// The configuration of a multilayer perceptron, except its input and output sizes.
struct HeadConfig {
    std::int64_t hidden_layers = 1;                 // 0: the output layer alone
    std::int64_t hidden_units = 512;                // of each hidden layer
    Layer::Kind activation = Layer::Kind::relu;     // of the hidden layers: relu or tanh
    Initialiser initialise = glorot_uniform();      // of the hidden layers
    Initialiser initialise_out = glorot_uniform();  // of the last one
    bool layer_norm = false;                        // before every activation
};

/// Returns fc1, fc2, ..., each with its activation. Throws std::invalid_argument for fewer than no layers or
/// than one unit.
Layers hidden_layers(const HeadConfig& config);

/// fc1, fc2, ..., each with its activation, then out.
class MlpImpl : public torch::nn::Module {
  public:
    MlpImpl(std::int64_t in, std::int64_t out, const HeadConfig& config, at::Generator generator);
    /// [B, in] -> [B, out] of the parameters' type
    torch::Tensor forward(torch::Tensor x);

  private:
    LayerStack hidden_;
    Dense out_{nullptr};
};
using Mlp = torch::nn::ModuleHolder<MlpImpl>;

/// What two critics together estimate: the smaller value (Fujimoto et al. 2018), or the mean (Zhou et al.
/// 2022, "Revisiting Discrete Soft Actor-Critic").
enum class TwinEstimate { minimum, mean };
std::span<const std::string_view> names_of(TwinEstimate);

/// Two estimates of the same action values, of one shape.
struct TwinValues {
    torch::Tensor q1, q2;  // the two critics'
    /// What the two of them together estimate.
    torch::Tensor estimate(TwinEstimate how) const {
        return how == TwinEstimate::minimum ? torch::minimum(q1, q2) : (q1 + q2) / 2;
    }
};

/// Two independent critics q1 and q2, as clipped double Q-learning has them (Fujimoto et al. 2018).
class TwinCriticImpl : public torch::nn::Module {
  public:
    TwinCriticImpl(std::int64_t in, std::int64_t out, const HeadConfig& config, at::Generator generator);
    /// [B, in] -> [B, out] each
    TwinValues forward(const torch::Tensor& x);

  private:
    Mlp q1_{nullptr}, q2_{nullptr};
};
using TwinCritic = torch::nn::ModuleHolder<TwinCriticImpl>;

/// A box of actions, as its centre and half its width: [A] each, on the device of the actions.
struct ActionBox {
    torch::Tensor centre, half_width;  // [A] each
    double log_half_widths = 0;        // sum over coordinates
    torch::Tensor landmarks{};  // [K, A] that random actions are chosen among; undefined: the whole box
};

/// CALE's joystick (r, theta, fire) in [0, 1] x [-pi, pi] x [0, 1], float32 on the CPU.
ActionBox joystick_box();

/// Returns the box of a space, float32 on the CPU, without landmarks: the joystick's for a discrete space,
/// which has none. Throws std::invalid_argument for limits that are not finite, in order or pairs.
ActionBox action_box(const ActionSpace& space);

/// The action centre + half_width * tanh(u), where u is normal with this mean and
/// exp(log_std), which is neither clamped nor squashed: [B, A] each.
struct SquashedGaussian {
    torch::Tensor mean, log_std;  // before the tanh
};

/// Splits an actor's output [B, 2 A] into means and log standard deviations.
SquashedGaussian squashed_gaussian(const torch::Tensor& actor_output);

/// A sampled action [B, A] and its log-density [B] in the units of the box.
struct PolicySample {
    torch::Tensor action, log_prob;  // [B, A] and [B]
};

/// Reparameterised with standard normal `noise` [B, A]. The density is computed from the
/// value before the tanh, so it stays finite where the tanh saturates.
PolicySample sample(const SquashedGaussian& policy, const torch::Tensor& noise, const ActionBox& box);

/// centre + half_width * tanh(mean): [B, A].
torch::Tensor mean_action(const SquashedGaussian& policy, const ActionBox& box);

/// The log-density [B] of given actions [B, A]. Actions on the box's border, where the density
/// ends, are taken for the nearest float inside.
torch::Tensor log_prob(const SquashedGaussian& policy, const torch::Tensor& action, const ActionBox& box);

/// [count, A]: one of the box's landmarks each, or without landmarks anywhere in the box, where coordinates
/// are independent: uniform in (r, theta) and not on the disc.
torch::Tensor uniform_actions(const ActionBox& box, std::int64_t count, at::Generator random);

/// Replaces each action [N, A] of the box, on the CPU, by a uniform one with this probability: where a number
/// of [0, 1) is no larger, as in Dopamine. Draws for an epsilon of 0, too.
torch::Tensor epsilon_greedy(const torch::Tensor& actions, double epsilon, const ActionBox& box,
                             at::Generator random);

}  // namespace cale
