// What the networks of this project's policies are made of, as data: whoever evaluates one, exports it or
// checks its weights reads it here. The layers themselves are described in networks/encoders.h, heads.h and
// q_network.h.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "policy/stored_tensors.h"

namespace cale {

/// The acting half of a network: a trunk of convolutions, what follows it, hidden layers, and a head.
struct PolicyNetwork {
    enum class Encoder { phi_sac, phi_dqn, impala };
    enum class Rows { conv2d, row1d };  // phi_dqn on images, or row by row
    enum class Padding { same, valid };
    /// none: the features themselves (DQN, DER); actor: the actor's dense layer of CALE's two branches;
    /// shared: 512 features with ReLU (PPO's usual network).
    enum class Branch { none, actor, shared };
    enum class Activation { relu, tanh };  // of the hidden layers
    /// squashed_gaussian: means and log standard deviations are the last layer's; gaussian: the deviations
    /// are numbers of their own; categorical: logits; values: action values.
    enum class Head { squashed_gaussian, gaussian, categorical, values };

    std::int64_t stack = 4, frame_height = 84, frame_width = 84;
    Encoder encoder = Encoder::phi_sac;
    Rows phi_dqn = Rows::conv2d;
    Padding padding = Padding::same;
    Branch branch = Branch::actor;
    std::int64_t hidden_layers = 1;
    std::int64_t hidden_units = 512;
    Activation activation = Activation::relu;
    Head head = Head::squashed_gaussian;
    std::int64_t num_actions = 0;  // 0: the continuous joystick
    bool dueling = false;          // of values: the actions' advantages and the state's value apart
    std::int64_t num_atoms = 1;    // of values: more than one is a distribution (C51) ...
    double value_limit = 10;       // ... over returns from -value_limit to value_limit

    bool continuous() const { return head == Head::squashed_gaussian || head == Head::gaussian; }
};

inline constexpr std::int64_t kStickSize = 3;  // r, theta, fire

/// Channels, rows and columns of an image.
struct ImageSize {
    std::int64_t channels = 0, rows = 0, columns = 0;
    std::int64_t count() const { return channels * rows * columns; }
};

/// One layer. Those with parameters have `name`.weight and `name`.bias.
struct Layer {
    enum class Kind {
        conv,      // zeros around the image, then a convolution
        max_pool,  // minus infinity around the image
        relu,
        tanh,
        keep,      // remembers the image ...
        add_kept,  // ... that is added here
        flatten,   // in the order channel, row, column
        dense,
        layer_norm,  // with epsilon 1e-6
    };
    Kind kind = Kind::relu;
    std::string name{};
    ImageSize in{}, out{};
    std::int64_t kernel_rows = 1, kernel_columns = 1, stride_rows = 1, stride_columns = 1;
    std::int64_t top = 0, left = 0, bottom = 0, right = 0;  // padding
    /// Of phi_dqn row by row: the only column of the stored kernel [out, in, k, k] that is used, turned along
    /// the row.
    std::int64_t kernel_slice = -1;

    bool has_parameters() const {
        return kind == Kind::conv || kind == Kind::dense || kind == Kind::layer_norm;
    }
};

inline constexpr double kLayerNormEpsilon = 1e-6;

/// From pixels, scaled to 0 ... 1, to what the head reads; the last layer's out.channels.
/// Throws FileDamage where a convolution is wider than its image.
std::vector<Layer> layers_of(const PolicyNetwork& network);

/// The head's own dense layers: {"actor.out"}, {"actor.mean"}, {"head.out"} or {"head.adv", "head.value"}.
std::vector<Layer> head_layers_of(const PolicyNetwork& network, std::int64_t inputs);

/// Every parameter of the network with its shape, float32: "encoder.conv1.weight", ...
std::vector<NamedShape> parameters_of(const PolicyNetwork& network);

/// Numbers of Policy::output.
std::int64_t output_size(const PolicyNetwork& network);

}  // namespace cale
