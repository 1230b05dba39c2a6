// Reads the golden network cases (tests/golden/README-agents.md): regenerates weights and
// inputs from the hash, and compares tensors with the summaries in the file.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <yaml-cpp/yaml.h>

#include "networks/adam.h"
#include "replay/replay.h"

namespace golden {

/// Relative tolerances, README-agents.md's column "use".
struct Tolerances {
    double forward, loss_first, loss_later, grad_l2, grad_entries, delta_l2, delta_entries;
};
Tolerances tolerances(torch::Dtype dtype);

/// Fills every parameter of `module` by the rules of the file's `params`. The names and shapes
/// must be the file's exactly. `weights_case` is the case's name, with "/target" for the target.
void load_weights(torch::nn::Module& module, const YAML::Node& file, const std::string& weights_case);

/// Element-wise uniforms of the stream `case_name/name`, float64.
torch::Tensor uniforms(const std::string& case_name, const std::string& name, at::IntArrayRef shape);

/// [B, 4, 84, 84] uint8 on the device of the tests; checked against the echo in the file's `inputs`.
torch::Tensor observations(const YAML::Node& file, const std::string& name, std::int64_t batch);

/// A scalar or nested sequence as float64.
torch::Tensor tensor(const YAML::Node& node);

/// |actual - expected| <= tolerance * max |expected| in every entry.
void expect_close(const torch::Tensor& actual, const torch::Tensor& expected, double tolerance,
                  const std::string& what);

/// Compares `l2`, `proj` and `first4` (each behind `prefix`) of a tensor known as `name`.
void expect_summary(const torch::Tensor& actual, const YAML::Node& summary, const std::string& prefix,
                    const std::string& case_name, const std::string& name, double l2_tolerance,
                    double entry_tolerance, const std::string& what);

using Tensors = std::map<std::string, torch::Tensor>;
/// Copies of a module's parameters, and of their gradients, by name.
Tensors parameters(const torch::nn::Module& module);
Tensors gradients(const torch::nn::Module& module);

/// One case file in one floating-point type, as every agent's golden test has it.
struct NetworkCase {
    NetworkCase(const std::string& file_name, torch::Dtype dtype);

    YAML::Node file;
    std::string name;
    torch::Dtype dtype;
    torch::Device device;
    Tolerances tolerance;
    std::int64_t batch_size;

    double hyper(const std::string& key) const;
    /// The units of each of the actor's hidden layers, by `params`.
    std::vector<std::int64_t> actor_layers() const;
    /// The optimiser's `lr`, `beta1`, `beta2` and `adam_eps`.
    cale::AdamConfig adam() const;
    /// `inputs` of this key, in the case's type and on its device.
    torch::Tensor input(const std::string& key) const;
    torch::Tensor actions() const;  // of `inputs`, int64; checked against the hash
    torch::Tensor discount() const;
    cale::Batch batch() const;  // of discrete actions

    void expect(const torch::Tensor& actual, const YAML::Node& node, const std::string& key,
                double tolerance) const;
    void expect_gradients(const torch::nn::Module& module) const;
    /// `node` is params_after1 and so on; nothing happens where the file lacks it.
    void expect_moved(const torch::nn::Module& module, const Tensors& initial, const std::string& node) const;
};

/// Every file of these kinds in float32 and float64, and the name of such a pair.
using FileAndType = std::tuple<std::string, torch::Dtype>;
std::vector<FileAndType> files_and_types(std::string_view kind);
std::string name_of(const ::testing::TestParamInfo<FileAndType>& chosen);

}  // namespace golden
