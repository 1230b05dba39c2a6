// Action values from frames: the network of DQN and, piece by piece, of Rainbow.
//   Mnih et al. 2015 (plain), Wang et al. 2016 (dueling), Bellemare et al. 2017 (a distribution
//   over atoms), Fortunato et al. 2018 (noisy), Hessel et al. 2018 (all of them)
#pragma once

#include <cstdint>
#include <vector>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/encoders.h"
#include "networks/layers.h"

namespace cale {

/// A head for action values.
struct QHeadConfig {
    std::int64_t num_actions = 0;     // at least 1
    std::int64_t hidden_units = 512;  // of the hidden layer
    std::int64_t num_atoms = 1;       // per action
    bool dueling = false;             // a state's value and the advantages apart
    bool noisy = false;               // noisy layers instead of dense ones
    bool noisy_evaluation = false;    // with noise where the network is evaluated, too
    double initial_sigma = 0.1;       // of noisy layers
    double value_limit = 10;  // the atoms of a distribution are returns from -value_limit to value_limit
    /// Discrete::factors: an action's output is then the mean of its choices' outputs, one for each set.
    std::vector<std::int64_t> factors = {};
    bool layer_norm = false;  // before the hidden layer's activation
};

/// Standard normal numbers of one pass. The layers behind the hidden one share their input's draw, as in
/// the reference, where one key serves all layers.
struct QNoise {
    FactorisedNoise hidden, out, value;  // value: used where dueling
};

/// Returns the specification of a network with this encoder and this head.
NetworkSpec values_spec(std::vector<std::int64_t> observation, const Layers& encoder,
                        const QHeadConfig& config);

/// Returns value + advantages - their mean over the actions: [B, 1, atoms] and [B, A, atoms] -> [B, A, atoms]
/// (Wang et al. 2016, equation 9).
torch::Tensor dueling_values(const torch::Tensor& value, const torch::Tensor& advantages);

/// Returns factor_means() as a tensor [A, sum of factors].
torch::Tensor factor_matrix(const std::vector<std::int64_t>& factors);

/// fc1 with ReLU, then `out` [A x atoms], or `adv` [A x atoms] and `value` [atoms] where dueling:
/// value + adv - mean over the actions of adv. Dense layers are Glorot, or noisy. With factors, `out` or
/// `adv` has an output for every choice instead of every action.
class QHeadImpl : public torch::nn::Module {
  public:
    /// Throws std::invalid_argument for fewer than one action, unit or atom, or factors of another product.
    QHeadImpl(std::int64_t in, const QHeadConfig& config, at::Generator generator);

    /// [B, in] -> [B, A, atoms]. Layers that are not noisy ignore the noise; noisy ones are their means
    /// without.
    torch::Tensor forward(const torch::Tensor& features, const QNoise* noise = nullptr);

    /// One draw for a whole batch, [size] each, or one for each of `rows` rows, [rows, size] each. Float32,
    /// on the generator's device; empty unless noisy.
    QNoise draw_noise(at::Generator generator, std::int64_t rows = 1) const;

  private:
    QHeadConfig config_;
    std::int64_t in_;
    std::int64_t choices_;   // outputs of the last layer, each of num_atoms
    torch::Tensor combine_;  // factor_matrix(), a buffer; undefined without factors
    AnyDense fc1_, out_, value_;
    torch::nn::LayerNorm norm_{nullptr};  // ln1, where layer_norm
};
using QHead = torch::nn::ModuleHolder<QHeadImpl>;

/// A trunk without a head.
class TrunkEncoderImpl : public torch::nn::Module {
  public:
    TrunkEncoderImpl(const EncoderConfig& config, const at::Generator& generator)
        : trunk_(*this, config, generator) {}
    /// [B, observation] uint8 -> [B, size()]
    torch::Tensor forward(const torch::Tensor& observation) const { return trunk_(observation); }
    std::int64_t size() const { return trunk_.features(); }  // numbers per observation

  private:
    Trunk trunk_;
};
using TrunkEncoder = torch::nn::ModuleHolder<TrunkEncoderImpl>;

/// encoder.conv1, ..., head.fc1, ...: [B, stack, ...] uint8 -> [B, A, atoms].
class QNetworkImpl : public torch::nn::Module {
  public:
    QNetworkImpl(const EncoderConfig& encoder_config, const QHeadConfig& head_config,
                 at::Generator generator);
    /// [B, stack, ...] uint8 -> [B, A, atoms]; without noise, noisy layers are their means.
    torch::Tensor forward(const torch::Tensor& observation, const QNoise* noise = nullptr);

    TrunkEncoder encoder{nullptr};  // parameters encoder.*
    QHead head{nullptr};            // parameters head.*
    NetworkSpec acting;             // as evaluations act
};
using QNetwork = torch::nn::ModuleHolder<QNetworkImpl>;

/// The same numbers on a device, in a floating-point type.
QNoise to(const QNoise& noise, const torch::TensorOptions& options);

}  // namespace cale
