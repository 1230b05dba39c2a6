#include "golden_network.h"

#include <cmath>
#include <set>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "support/golden.h"
#include "test_device.h"

namespace golden {
namespace {

torch::Tensor weights(const std::string& weights_case, const YAML::Node& param) {
    const auto shape = param["shape"].as<std::vector<std::int64_t>>();
    const auto rule = param["rule"].as<std::string>();
    const double fan_in = param["fan_in"].as<double>();
    if (rule == "sigma") return torch::full(shape, 0.5 / std::sqrt(fan_in), torch::kFloat64);
    const auto centred = 2 * uniforms(weights_case, param["name"].as<std::string>(), shape) - 1;
    if (rule == "uniform") return centred / std::sqrt(fan_in);
    if (rule == "ln_weight") return 1 + 0.1 * centred;
    if (rule == "ln_bias") return 0.1 * centred;
    throw std::runtime_error("golden files have no rule '" + rule + "'");
}

double largest(const torch::Tensor& x) {
    return x.numel() == 0 ? 0 : x.abs().max().item<double>();
}

}  // namespace

Tolerances tolerances(torch::Dtype dtype) {
    if (dtype == torch::kFloat64) return {3e-5, 3e-5, 1e-4, 3e-5, 3e-5, 1e-3, 2e-3};
    return {1e-4, 1e-4, 1e-3, 1e-4, 1e-3, 1e-3, 5e-3};
}

void load_weights(torch::nn::Module& module, const YAML::Node& file, const std::string& weights_case) {
    const torch::NoGradGuard no_grad;
    auto parameters = module.named_parameters();
    std::set<std::string> filled;
    for (const auto& param : file["params"]) {
        const auto name = param["name"].as<std::string>();
        auto* parameter = parameters.find(name);
        if (parameter == nullptr) throw std::runtime_error("the network has no parameter " + name);
        const auto value = weights(weights_case, param).to(torch::kFloat32);
        if (parameter->sizes() != value.sizes()) throw std::runtime_error(name + " has another shape");
        parameter->copy_(value);
        filled.insert(name);
    }
    for (const auto& parameter : parameters) {
        if (!filled.contains(parameter.key())) throw std::runtime_error("the file lacks " + parameter.key());
    }
}

torch::Tensor uniforms(const std::string& case_name, const std::string& name, at::IntArrayRef shape) {
    auto values = torch::empty(shape, torch::kFloat64);
    const auto stream = seed(case_name, name);
    auto* entry = values.data_ptr<double>();
    for (std::int64_t i = 0; i < values.numel(); ++i)
        entry[i] = uniform(stream, static_cast<std::uint64_t>(i));
    return values;
}

torch::Tensor observations(const YAML::Node& file, const std::string& name, std::int64_t batch) {
    auto pixels = torch::empty({batch, 4, 84, 84}, torch::kUInt8);
    const auto stream = seed(file["case"].as<std::string>(), name);
    auto* pixel = pixels.data_ptr<std::uint8_t>();
    for (std::int64_t i = 0; i < pixels.numel(); ++i)
        pixel[i] = static_cast<std::uint8_t>(bits(stream, static_cast<std::uint64_t>(i)) >> 56);
    EXPECT_EQ(pixels.sum().item<std::int64_t>(), file["inputs"][name]["sum"].as<std::int64_t>()) << name;
    return pixels.to(cale::test_device());
}

torch::Tensor tensor(const YAML::Node& node) {
    if (node.IsScalar()) return torch::tensor(node.as<double>(), torch::kFloat64);
    std::vector<torch::Tensor> rows;
    for (const auto& row : node) rows.push_back(tensor(row));
    return torch::stack(rows);
}

void expect_close(const torch::Tensor& actual, const torch::Tensor& expected, double tolerance,
                  const std::string& what) {
    ASSERT_EQ(actual.sizes(), expected.sizes()) << what;
    const double error = largest(actual.detach().to(torch::kCPU, torch::kFloat64) - expected);
    EXPECT_LE(error, tolerance * largest(expected) + 1e-12)
        << what << " is " << actual << "\nnot " << expected;
}

void expect_summary(const torch::Tensor& actual, const YAML::Node& summary, const std::string& prefix,
                    const std::string& case_name, const std::string& name, double l2_tolerance,
                    double entry_tolerance, const std::string& what) {
    const auto entries = actual.detach().to(torch::kCPU, torch::kFloat64).contiguous().flatten();
    const auto probe = 2 * uniforms(case_name, "probe/" + name, entries.sizes()) - 1;
    const double l2 = summary[prefix + "l2"].as<double>();
    const double proj = summary[prefix + "proj"].as<double>();
    const auto first4 = tensor(summary[prefix + "first4"]);
    const double rms = l2 / std::sqrt(static_cast<double>(entries.numel()));
    const auto label = what + " of " + name + ": " + prefix;
    EXPECT_NEAR(entries.norm().item<double>(), l2, l2_tolerance * l2 + 1e-15) << label << "l2";
    EXPECT_NEAR(entries.dot(probe).item<double>(), proj, entry_tolerance * l2 + 1e-15) << label << "proj";
    const double error = largest(entries.narrow(0, 0, first4.numel()) - first4);
    EXPECT_LE(error, entry_tolerance * std::max(largest(first4), rms) + 1e-15) << label << "first4";
}

Tensors parameters(const torch::nn::Module& module) {
    Tensors copies;
    for (const auto& parameter : module.named_parameters())
        copies[parameter.key()] = parameter.value().detach().clone();
    return copies;
}

Tensors gradients(const torch::nn::Module& module) {
    Tensors copies;
    for (const auto& parameter : module.named_parameters())
        copies[parameter.key()] = parameter.value().grad().clone();
    return copies;
}

NetworkCase::NetworkCase(const std::string& file_name, torch::Dtype type)
    : file(load(file_name)),
      name(file["case"].as<std::string>()),
      dtype(type),
      device(cale::test_device()),
      tolerance(tolerances(type)),
      batch_size(file["hyper"]["batch"].as<std::int64_t>()) {}

double NetworkCase::hyper(const std::string& key) const {
    return file["hyper"][key].as<double>();
}

std::vector<std::int64_t> NetworkCase::actor_layers() const {
    std::vector<std::int64_t> layers;
    for (const auto& parameter : file["params"]) {
        const auto parameter_name = parameter["name"].as<std::string>();
        if (parameter_name.starts_with("actor.fc") && parameter_name.ends_with(".bias"))
            layers.push_back(parameter["shape"][0].as<std::int64_t>());
    }
    return layers;
}

cale::AdamConfig NetworkCase::adam() const {
    return {.learning_rate = hyper("lr"),
            .beta1 = hyper("beta1"),
            .beta2 = hyper("beta2"),
            .epsilon = hyper("adam_eps")};
}

torch::Tensor NetworkCase::input(const std::string& key) const {
    return tensor(file["inputs"][key]).to(device, dtype);
}

torch::Tensor NetworkCase::actions() const {
    const auto echoed = tensor(file["inputs"]["action"]).to(torch::kInt64);
    const auto hashed =
        (uniforms(name, "action", {batch_size}) * hyper("num_actions")).floor().to(torch::kInt64);
    EXPECT_TRUE(torch::equal(hashed, echoed)) << "the hashed actions";
    return echoed.to(device);
}

torch::Tensor NetworkCase::discount() const {
    return hyper("cumulative_gamma") * (1 - input("terminal"));
}

cale::Batch NetworkCase::batch() const {
    cale::Batch made;
    made.observation = observations(file, "obs", batch_size);
    made.next_observation = observations(file, "next_obs", batch_size);
    made.action = actions();
    made.n_step_return = input("reward");
    made.discount = discount();
    return made;
}

void NetworkCase::expect(const torch::Tensor& actual, const YAML::Node& node, const std::string& key,
                         double relative) const {
    expect_close(actual, tensor(node[key]), relative, key);
}

namespace {

void expect_summaries(const NetworkCase& c, const Tensors& values, const std::string& node,
                      const std::string& prefix, double l2, double entries) {
    const auto summaries = c.file[node];
    ASSERT_EQ(values.size(), summaries.size());
    for (const auto& [name, value] : values)
        expect_summary(value, summaries[name], prefix, c.name, name, l2, entries, node);
}

}  // namespace

void NetworkCase::expect_gradients(const torch::nn::Module& module) const {
    expect_summaries(*this, gradients(module), "grad", "", tolerance.grad_l2, tolerance.grad_entries);
}

void NetworkCase::expect_moved(const torch::nn::Module& module, const Tensors& initial,
                               const std::string& node) const {
    if (!file[node]) return;
    auto deltas = parameters(module);
    for (auto& [parameter, value] : deltas) value -= initial.at(parameter);
    expect_summaries(*this, deltas, node, "delta_", tolerance.delta_l2, tolerance.delta_entries);
}

std::vector<FileAndType> files_and_types(std::string_view kind) {
    std::vector<FileAndType> pairs;
    for (const auto& file : files_of_kind(kind))
        for (const auto type : {torch::kFloat32, torch::kFloat64}) pairs.emplace_back(file, type);
    return pairs;
}

std::string name_of(const ::testing::TestParamInfo<FileAndType>& chosen) {
    const auto& [file, type] = chosen.param;
    return file.substr(0, file.find('.')) + (type == torch::kFloat64 ? "_float64" : "_float32");
}

}  // namespace golden
