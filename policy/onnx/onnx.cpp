#include "policy/onnx/onnx.h"

#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "onnx.pb.h"
#include "policy/factor_means.h"
#include "policy/network_parameters.h"

namespace cale {
namespace {

enum DataType : int { kFloat = 1, kUint8 = 2, kInt64 = 7 };
enum AttributeType : int { kFloatAttribute = 1, kIntAttribute = 2, kIntsAttribute = 7 };

constexpr std::int64_t kIrVersion = 8;
constexpr std::int64_t kOperatorVersion = 17;  // the first with LayerNormalization

using Ints = std::vector<std::int64_t>;

/// Adds operators to a graph; `now` is what the next one works on.
class GraphWriter {
  public:
    explicit GraphWriter(onnx::Graph& graph) : graph_(graph) {}

    std::string now;

    /// Adds an operator on `inputs` and makes its result `now`.
    onnx::Node& add(const char* type, const std::vector<std::string>& inputs) {
        auto& node = *graph_.add_node();
        node.set_op_type(type);
        for (const auto& input : inputs) node.add_input(input);
        now = fmt::format("x{}", graph_.node_size());
        node.add_output(now);
        return node;
    }
    onnx::Node& add(const char* type) { return add(type, {now}); }

    /// The result of the newest operator gets this name.
    void name_result(const std::string& name) {
        graph_.mutable_node(graph_.node_size() - 1)->set_output(0, name);
        now = name;
    }

    std::string constant(const std::string& name, const Ints& shape, const std::vector<float>& numbers) {
        return constant(name, shape, kFloat,
                        {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(float)});
    }
    std::string constant(const std::string& name, const Ints& numbers) {
        return constant(
            name, {static_cast<std::int64_t>(numbers.size())}, kInt64,
            {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(std::int64_t)});
    }

  private:
    std::string constant(const std::string& name, const Ints& shape, DataType type, std::string_view bytes) {
        auto& tensor = *graph_.add_initializer();
        tensor.set_name(name);
        tensor.set_data_type(type);
        for (const auto size : shape) tensor.add_dims(size);
        tensor.set_raw_data(bytes.data(), bytes.size());
        return name;
    }

    onnx::Graph& graph_;
};

void set(onnx::Node& node, const char* name, const Ints& values) {
    auto& attribute = *node.add_attribute();
    attribute.set_name(name);
    attribute.set_type(kIntsAttribute);
    for (const auto value : values) attribute.add_ints(value);
}
void set(onnx::Node& node, const char* name, std::int64_t value) {
    auto& attribute = *node.add_attribute();
    attribute.set_name(name);
    attribute.set_type(kIntAttribute);
    attribute.set_i(value);
}
void set(onnx::Node& node, const char* name, float value) {
    auto& attribute = *node.add_attribute();
    attribute.set_name(name);
    attribute.set_type(kFloatAttribute);
    attribute.set_f(value);
}

class Writer {
  public:
    Writer(onnx::Graph& graph, const PolicyFile& policy) : policy_(policy), graph_(graph) {}

    void write() {
        set(graph_.add("Cast", {"observation"}), "to", std::int64_t{kFloat});
        graph_.add("Div", {graph_.now, graph_.constant("white", {}, {255})});
        const auto layers = sized_layers(policy_.network);
        for (const auto& layer : layers) add(layer);
        add_head(layers.back().out.channels);
        graph_.name_result("output");
        add_action();
        graph_.name_result("action");
    }

  private:
    void window(onnx::Node& node, const SizedLayer& layer) const {
        set(node, "kernel_shape", Ints{layer.kernel_rows, layer.kernel_columns});
        set(node, "strides", Ints{layer.stride_rows, layer.stride_columns});
        set(node, "pads", Ints{layer.top, layer.left, layer.bottom, layer.right});
    }

    /// Stored square; of kernels along a row only one column is used.
    std::vector<float> kernel(const SizedLayer& layer) const {
        const auto& stored = policy_.weights.at(layer.name + ".weight");
        if (layer.kernel_slice < 0) return stored;
        std::vector<float> column;
        for (auto i = layer.kernel_slice; i < std::ssize(stored); i += layer.kernel_columns)
            column.push_back(stored[static_cast<std::size_t>(i)]);
        return column;
    }

    std::string parameter(const std::string& name, const Ints& shape) {
        return graph_.constant(name, shape, policy_.weights.at(name));
    }

    void add(const SizedLayer& layer) {
        switch (layer.kind) {
            case Layer::Kind::conv: {
                const Ints shape{layer.out.channels, layer.in.channels, layer.kernel_rows,
                                 layer.kernel_columns};
                const auto weight = graph_.constant(layer.name + ".weight", shape, kernel(layer));
                window(graph_.add("Conv", {graph_.now, weight, parameter(layer.name + ".bias", {shape[0]})}),
                       layer);
                break;
            }
            case Layer::Kind::max_pool:
                window(graph_.add("MaxPool"), layer);
                break;
            case Layer::Kind::relu:
                graph_.add("Relu");
                break;
            case Layer::Kind::tanh:
                graph_.add("Tanh");
                break;
            case Layer::Kind::keep:
                kept_ = graph_.now;
                break;
            case Layer::Kind::add_kept:
                graph_.add("Add", {kept_, graph_.now});
                break;
            case Layer::Kind::flatten:
                graph_.add("Flatten");
                break;
            case Layer::Kind::dense:
                add_dense(layer);
                break;
            case Layer::Kind::layer_norm: {
                auto& node = graph_.add("LayerNormalization",
                                        {graph_.now, parameter(layer.name + ".weight", {layer.out.channels}),
                                         parameter(layer.name + ".bias", {layer.out.channels})});
                set(node, "epsilon", static_cast<float>(kLayerNormEpsilon));
                break;
            }
        }
    }

    void add_dense(const SizedLayer& layer) {
        auto& node = graph_.add(
            "Gemm", {graph_.now, parameter(layer.name + ".weight", {layer.out.channels, layer.in.channels}),
                     parameter(layer.name + ".bias", {layer.out.channels})});
        set(node, "transB", std::int64_t{1});
    }

    void add_head(std::int64_t inputs) {
        const auto& head = policy_.network.head;
        const auto hidden = graph_.now;
        const auto layers = head_layers(head, inputs);
        add_dense(layers[0]);
        if (head.kind == Head::Kind::gaussian) {
            // The same deviations for every observation.
            const auto mean = graph_.now;
            graph_.add("Mul", {mean, graph_.constant("zero", {}, {0})});
            graph_.add("Add", {graph_.now, parameter("actor.log_std", {head.axes})});
            set(graph_.add("Concat", {mean, graph_.now}), "axis", std::int64_t{1});
        }
        if (head.kind == Head::Kind::categorical) set(graph_.add("LogSoftmax"), "axis", std::int64_t{1});
        if (head.kind == Head::Kind::values) add_values(hidden, layers);
    }

    void add_values(const std::string& hidden, const std::vector<SizedLayer>& layers) {
        const auto& head = policy_.network.head;
        const auto actions = head.num_actions, atoms = head.num_atoms;
        graph_.add("Reshape",
                   {graph_.now, graph_.constant("per_action", Ints{-1, num_outputs(head), atoms})});
        if (!head.factors.empty()) {
            const auto means =
                graph_.constant("factor_means", {actions, num_outputs(head)}, factor_means(head.factors));
            graph_.add("MatMul", {means, graph_.now});
        }
        if (head.dueling) {
            const auto advantages = graph_.now;
            graph_.now = hidden;
            add_dense(layers[1]);
            graph_.add("Reshape", {graph_.now, graph_.constant("per_state", Ints{-1, 1, atoms})});
            graph_.add("Add", {graph_.now, advantages});
            const auto sum = graph_.now;
            set(graph_.add("ReduceMean", {advantages}), "axes", Ints{1});
            graph_.add("Sub", {sum, graph_.now});
        }
        if (atoms > 1) {
            std::vector<float> returns;
            for (std::int64_t i = 0; i < atoms; ++i) {
                returns.push_back(static_cast<float>(
                    head.value_limit * (2 * static_cast<double>(i) / static_cast<double>(atoms - 1) - 1)));
            }
            set(graph_.add("Softmax"), "axis", std::int64_t{2});
            graph_.add("Mul", {graph_.now, graph_.constant("returns", {atoms}, returns)});
            auto& sum = graph_.add("ReduceSum", {graph_.now, graph_.constant("of_atoms", Ints{2})});
            set(sum, "keepdims", std::int64_t{0});
        } else {
            graph_.add("Reshape", {graph_.now, graph_.constant("without_atoms", Ints{-1, actions})});
        }
    }

    void add_action() {
        const auto& head = policy_.network.head;
        if (!head.continuous()) {
            auto& node = graph_.add("ArgMax");
            set(node, "axis", std::int64_t{1});
            set(node, "keepdims", std::int64_t{0});
            return;
        }
        std::vector<float> centre, half_width;
        for (const auto& [name, low, high] : stick_coordinates(policy_.info.joystick)) {
            centre.push_back((low + high) / 2);
            half_width.push_back((high - low) / 2);
        }
        graph_.add("Slice",
                   {graph_.now, graph_.constant("first", Ints{0}),
                    graph_.constant("end_of_means", Ints{head.axes}), graph_.constant("axis", Ints{1})});
        graph_.add("Tanh");
        graph_.add("Mul", {graph_.now, graph_.constant("half_width", {head.axes}, half_width)});
        graph_.add("Add", {graph_.now, graph_.constant("centre", {head.axes}, centre)});
    }

    const PolicyFile& policy_;
    GraphWriter graph_;
    std::string kept_;
};

/// A tensor whose first dimension is the number of observations.
void describe(onnx::ValueInfo& value, const char* name, DataType type, const Ints& shape) {
    value.set_name(name);
    auto& tensor = *value.mutable_type()->mutable_tensor_type();
    tensor.set_elem_type(type);
    tensor.mutable_shape()->add_dim()->set_dim_param("N");
    for (const auto size : shape) tensor.mutable_shape()->add_dim()->set_dim_value(size);
}

}  // namespace

std::string onnx_model(const PolicyFile& policy) {
    const auto& network = policy.network;
    onnx::Model model;
    model.set_ir_version(kIrVersion);
    model.set_producer_name("cale");
    model.add_opset_import()->set_version(kOperatorVersion);
    auto& graph = *model.mutable_graph();
    graph.set_name("policy");
    describe(*graph.add_input(), "observation", kUint8, network.observation);
    if (network.head.continuous()) {
        describe(*graph.add_output(), "action", kFloat, {network.head.axes});
    } else {
        describe(*graph.add_output(), "action", kInt64, {});
    }
    describe(*graph.add_output(), "output", kFloat, {output_size(network.head)});
    Writer(graph, policy).write();
    for (const auto& [key, text] : policy_file_texts(policy)) {
        auto& entry = *model.add_metadata_props();
        entry.set_key(key);
        entry.set_value(text);
    }
    auto bytes = model.SerializeAsString();
    if (bytes.empty())
        throw std::runtime_error("an ONNX model holds less than 2 GB, and this policy has more");
    return bytes;
}

}  // namespace cale
