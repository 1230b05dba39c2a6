// Optimisation over lists of parameters in fused kernels: torch::optim::Adam walks them
// one by one and cannot be captured in a CUDA graph.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include <torch/types.h>

namespace cale {

/// The defaults are those of CALE's agents.
struct AdamConfig {
    double learning_rate = 6.25e-5;  // the step size
    double beta1 = 0.9;              // decay of the first moment, per step
    double beta2 = 0.999;            // decay of the second
    double epsilon = 1.5e-4;         // outside the root
    /// Of AdamW (Loshchilov & Hutter 2019): p -= learning_rate * weight_decay * p before the step.
    double weight_decay = 0;
};

/// Kingma & Ba 2015, bias-corrected, epsilon outside the root:
/// p -= learning_rate * m / (1 - beta1^t) / (sqrt(v / (1 - beta2^t)) + epsilon).
class Adam {
  public:
    /// The parameters are floating-point leaves of one device and type, one or more (std::invalid_argument).
    Adam(std::vector<torch::Tensor> parameters, const AdamConfig& config);

    /// Allows a step() without these parameters, whose steps are counted separately. Throws std::logic_error
    /// the second time.
    void delay(const std::vector<torch::Tensor>& parameters);

    /// One step along the parameters' gradients, which must all be there; without the delayed parameters,
    /// along those of the others. Throws std::logic_error if not.
    void step(bool with_delayed = true);
    bool delays() const { return delayed_steps_.defined(); }  // whether delay() was called
    /// Forgets the gradients.
    void zero_grad();

    /// The moments and the number of steps, sharing memory with this object:
    /// "first_moment.0", ..., "second_moment.0", ..., "steps", and "delayed_steps" after delay().
    std::map<std::string, torch::Tensor> state() const;

    double learning_rate() const { return config_.learning_rate; }  // of the next step()
    /// Takes effect on a recorded step() too (see CapturedUpdate).
    void set_learning_rate(double learning_rate);

  private:
    AdamConfig config_;
    std::vector<torch::Tensor> parameters_, first_moments_, second_moments_;
    torch::Tensor steps_, delayed_steps_;       // [] float32 beside the parameters, as the kernel wants it
    std::vector<torch::Tensor> steps_of_each_;  // one of the two for every parameter
    torch::Tensor learning_rate_;               // [] float32 beside them, unless that is the CPU
};

/// target += tau * (online - target), in place: Polyak averaging. Throws std::invalid_argument
/// where the lists differ in length; tensors at the same place must have the same shape.
void soft_update(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online,
                 double tau);

/// Returns the parameters' gradients, in their order; undefined where a parameter has none.
std::vector<torch::Tensor> gradients_of(const std::vector<torch::Tensor>& parameters);

/// Scales the gradients of `parameters` down to the global norm `maximum` where it is larger, without a
/// wait for the device. Returns the norm before: [] float64.
torch::Tensor clip_gradient_norm(const std::vector<torch::Tensor>& parameters, double maximum);

/// Returns the global norm of the gradients that `parameters` have; none where one of them has none, or where
/// it is no finite number.
std::optional<double> gradient_norm(const std::vector<torch::Tensor>& parameters);

/// target = online, in place. Throws as soft_update() does.
void hard_update(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online);

}  // namespace cale
