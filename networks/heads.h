// What sits on an encoder's features: multilayer perceptrons, twin critics, and the
// tanh-squashed Gaussian policy on a box (Haarnoja et al. 2018, "Soft Actor-Critic", appendix C).
#pragma once

#include <cstdint>
#include <vector>

#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

struct HeadConfig {
    std::int64_t hidden_layers = 1;
    std::int64_t hidden_units = 512;
};

/// fc1, fc2, ... with ReLU, then out. Glorot.
class MlpImpl : public torch::nn::Module {
  public:
    MlpImpl(std::int64_t in, std::int64_t out, const HeadConfig& config, at::Generator generator);
    /// [B, in] -> [B, out]
    torch::Tensor forward(torch::Tensor x);

  private:
    std::vector<Dense> hidden_;
    Dense out_{nullptr};
};
using Mlp = torch::nn::ModuleHolder<MlpImpl>;

/// Two estimates of the same action value, [B] each.
struct TwinValues {
    torch::Tensor q1, q2;
    torch::Tensor minimum() const { return torch::minimum(q1, q2); }
};

/// Two independent critics of (features, action), clipped double Q-learning's (Fujimoto et al. 2018).
class TwinCriticImpl : public torch::nn::Module {
  public:
    TwinCriticImpl(std::int64_t features, std::int64_t action_size, const HeadConfig& config,
                   at::Generator generator);
    /// features [B, F], action [B, A] in the action box's own units.
    TwinValues forward(const torch::Tensor& features, const torch::Tensor& action);

  private:
    Mlp q1_{nullptr}, q2_{nullptr};
};
using TwinCritic = torch::nn::ModuleHolder<TwinCriticImpl>;

/// A box of actions, as its centre and half its width: [A] each, on the policy's device.
struct ActionBox {
    torch::Tensor centre, half_width;
    double log_half_widths = 0;  // sum over coordinates
};

/// CALE's joystick (r, theta, fire) in [0, 1] x [-pi, pi] x [0, 1], float32 on the CPU.
ActionBox joystick_box();

/// The action centre + half_width * tanh(u), where u is normal with this mean and
/// exp(log_std), which is neither clamped nor squashed: [B, A] each.
struct SquashedGaussian {
    torch::Tensor mean, log_std;
};

/// Splits an actor's output [B, 2 A] into means and log standard deviations.
SquashedGaussian squashed_gaussian(const torch::Tensor& actor_output);

/// A sampled action [B, A] and its log-density [B] in the units of the box.
struct PolicySample {
    torch::Tensor action, log_prob;
};

/// Reparameterised with standard normal `noise` [B, A]. The density is computed from the
/// value before the tanh, so it stays finite where the tanh saturates.
PolicySample sample(const SquashedGaussian& policy, const torch::Tensor& noise, const ActionBox& box);

/// centre + half_width * tanh(mean): [B, A].
torch::Tensor mean_action(const SquashedGaussian& policy, const ActionBox& box);

}  // namespace cale
