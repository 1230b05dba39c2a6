// Reads the golden network cases (tests/golden/README-agents.md): regenerates weights and
// inputs from the hash, and compares tensors with the summaries in the file.
#pragma once

#include <cstdint>
#include <string>

#include <torch/nn/module.h>
#include <torch/types.h>
#include <yaml-cpp/yaml.h>

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

/// [B, 4, 84, 84] uint8; checked against the echo in the file's `inputs`.
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

}  // namespace golden
