// A network as data: the layers that lead from an observation to an action, and the head behind them. Three
// things are built from it: LibTorch's modules (networks/layer_stack.h), the native plan of
// cale::lite::Policy (inference_plan.h) and the ONNX graph (policy/onnx/).
#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cale {

/// same: ceil(size / stride) positions, with zeros around the image. valid: no zeros are added.
enum class Padding { same, valid };
std::span<const std::string_view> names_of(Padding);

/// Returns the zeros (before, after) an axis that make a convolution return ceil(size / stride) positions. An
/// odd total puts the extra zero after, as JAX's and TensorFlow's "SAME" do.
std::pair<std::int64_t, std::int64_t> same_padding(std::int64_t size, std::int64_t kernel,
                                                   std::int64_t stride);

/// One layer. A convolution, a dense layer and a layer norm have the parameters `name`.weight and
/// `name`.bias.
struct Layer {
    /// What it does.
    enum class Kind {
        conv,        // a square convolution
        max_pool,    // the largest of a square window; minus infinity around the image
        relu,        // max(x, 0)
        tanh,        // the hyperbolic tangent
        keep,        // remembers what reaches it, for the next add_kept
        add_kept,    // adds what was kept: the end of a residual block
        flatten,     // an image as a vector, in the order channel, row, column
        dense,       // x W^T + b
        layer_norm,  // Ba et al. 2016, with epsilon 1e-6
    };
    Kind kind = Kind::relu;           // which of these
    std::string name{};               // of its parameters
    std::int64_t outputs = 0;         // channels of a convolution, units of a dense layer
    std::int64_t kernel = 0;          // of a convolution and of max_pool: rows and columns
    std::int64_t stride = 0;          // of both: pixels between neighbouring positions
    Padding padding = Padding::same;  // of a convolution
    /// Of a convolution: each row of the image by itself, as Dopamine's CALE agents run phi_dqn. The kernel's
    /// first axis runs along the row; of its second only the position that "SAME" padding puts on an axis of
    /// one pixel is used.
    bool rows = false;
    /// Of a dense layer: its weights have noise (NoisyDense) by the parameters `name`.weight_sigma and
    /// `name`.bias_sigma, drawn where actions are drawn and else 0.
    bool noisy = false;

    /// Returns a layer of this kind. The arguments are the members of their names.
    static Layer conv(std::string name, std::int64_t channels, std::int64_t kernel, std::int64_t stride,
                      Padding padding = Padding::same, bool rows = false);
    static Layer max_pool(std::int64_t kernel, std::int64_t stride);               // the same
    static Layer dense(std::string name, std::int64_t units, bool noisy = false);  // the same
    static Layer layer_norm(std::string name);                                     // the same
    /// A layer without parameters.
    static Layer of(Kind kind) { return {.kind = kind}; }

    bool operator==(const Layer&) const = default;
};
using Layers = std::vector<Layer>;  // in the order in which they are applied

inline constexpr double kLayerNormEpsilon = 1e-6;  // Flax's, not PyTorch's 1e-5

/// Returns the layers with `prefix` before the name of each that has one.
Layers prefixed(std::string_view prefix, Layers layers);
/// Returns all layers of the lists, one list behind the other.
Layers chain(std::initializer_list<Layers> lists);
/// fc1, fc2, ... of `units` each, each with its activation, Layer::Kind::relu or tanh, and ln1, ln2, ...
/// before those where `layer_norm`.
Layers hidden_layers(std::int64_t count, std::int64_t units, Layer::Kind activation, bool layer_norm = false);

/// The last dense layer, and how its numbers are an action.
struct Head {
    /// What the numbers are.
    enum class Kind {
        squashed_gaussian,  // actor.out: means and log standard deviations
        gaussian,           // actor.mean, and log standard deviations actor.log_std of their own
        categorical,        // actor.out: logits
        values,             // head.out, or head.adv and head.value where dueling: action values
    };
    Kind kind = Kind::squashed_gaussian;  // which of these
    std::int64_t num_actions = 0;         // 0: coordinates of the joystick
    bool dueling = false;                 // of values: the actions' advantages and the state's value apart
    std::int64_t num_atoms = 1;           // of values: more than one is a distribution (C51) ...
    double value_limit = 10;              // ... over returns from -value_limit to value_limit
    std::int64_t axes = 3;                // of the Gaussians: coordinates of an action
    bool noisy = false;                   // of values: the dense layers are noisy
    /// Of values, where not empty: sets of choices, of which an action takes one each (Discrete::factors).
    /// The layer has an output for every choice, and an action's is the mean of its choices'.
    std::vector<std::int64_t> factors{};

    /// Whether it acts by coordinates of the joystick.
    bool continuous() const { return kind == Kind::squashed_gaussian || kind == Kind::gaussian; }
    bool operator==(const Head&) const = default;
};

/// The acting half of a network.
struct NetworkSpec {
    std::vector<std::int64_t> observation{4, 84, 84};  // [stack, rows, columns], or [stack, bytes]
    Layers layers;                                     // from bytes, scaled to 0 ... 1, to a vector
    Head head;                                         // behind them

    bool operator==(const NetworkSpec&) const = default;
};

/// Returns whether a layer of the network is noisy.
bool is_noisy(const NetworkSpec& network);

// What a reader builds from a specification ---------------------------------------------

/// Channels, rows and columns of an image; of a vector only channels.
struct ImageSize {
    std::int64_t channels = 0, rows = 1, columns = 1;                 // 1, 1 of a vector
    std::int64_t count() const { return channels * rows * columns; }  // of numbers
    bool operator==(const ImageSize&) const = default;
};

/// A layer with the sizes that it has in a network.
struct SizedLayer : Layer {
    ImageSize in{}, out{};                             // what it takes, and what it makes of it
    std::int64_t kernel_rows = 1, kernel_columns = 1;  // the moving window; along rows less than `kernel`
    std::int64_t stride_rows = 1, stride_columns = 1;  // how far it moves
    std::int64_t top = 0, left = 0, bottom = 0, right = 0;  // padding
    /// Of convolutions along rows: the only column of the stored kernel [out, in, k, k] that is used.
    std::int64_t kernel_slice = -1;
};

/// Returns the layers on an input [channels, rows, columns], on bytes [stack, n] or on a vector [n]. Throws
/// std::invalid_argument, in one sentence, for layers that do not fit together or to the input.
std::vector<SizedLayer> sized_layers(const Layers& layers, const std::vector<std::int64_t>& input);
/// The same for all layers of a network, whose last result must be a vector.
std::vector<SizedLayer> sized_layers(const NetworkSpec& network);

}  // namespace cale
