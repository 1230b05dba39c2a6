// Exporting a run's policy.
#pragma once

#include <filesystem>
#include <string>

#include <torch/types.h>

#include "cale/env.h"
#include "policy/torch/policy.h"

namespace cale {

/// Returns the policy of a policy file, of a checkpoint (its folder, or the agent's file in it), or of a
/// run's folder (its newest checkpoint). Throws std::runtime_error, one sentence that names the path
/// and what is wrong with it.
Policy policy_of(const std::filesystem::path& path, torch::Device device = torch::kCPU);

/// Returns the contents, as bytes, of the policy file of such a path: a policy file's own, or made from a
/// checkpoint. Throws as policy_of() does.
std::string policy_file_of(const std::filesystem::path& path);

/// Writes the policy file of `path`, see policy_file_of(), atomically to `output`. Returns the policy's
/// description. Throws as policy_of() does, and std::system_error.
PolicyInfo export_policy(const std::filesystem::path& path, const std::filesystem::path& output);
/// The same network as an ONNX model: input "observation" [N, stack, 84, 84] or [N, stack, bytes] uint8, as
/// the policy sees; outputs "action", [N, coordinates] float32 or [N] int64, which is the greedy one, and
/// "output" as Policy::output.
PolicyInfo export_onnx(const std::filesystem::path& path, const std::filesystem::path& output);

/// Writes the web page of the policy to `folder`, which is made if need be, over files of these names that
/// are there: the page itself, copied from `page`, which scripts/web builds, and policy.safetensors. Returns
/// the policy's description. Throws std::runtime_error where `page` is not built, and for a policy that the
/// page cannot play; std::invalid_argument where that is because of its games.
PolicyInfo export_web_page(const std::filesystem::path& path, const std::filesystem::path& page,
                           const std::filesystem::path& folder);

/// The environment that the policy was trained in: the `env` section of its run's configuration.
/// Throws std::runtime_error where the policy does not hold one.
EnvConfig env_config_of(const PolicyInfo& info);

}  // namespace cale
