// The policy file of a checkpoint, made from the agent's policy and the run's description.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "agents/agent.h"
#include "policy/policy_info.h"
#include "settings/run_config.h"

namespace cale {

struct TrainingWorld;
struct TrainOptions;

/// The contents of a policy file.
struct PolicySnapshot {
    AgentPolicy agent;
    PolicyInfo info;  // except for the agent's part
};

/// Returns the weights as a policy file holds them.
std::map<std::string, std::vector<float>> numbers_of(const TensorMap& weights);

/// Returns a run's description for the policy file, without the current step; none for a world without policy
/// files.
std::optional<PolicyInfo> run_policy_info(const TrainingWorld& world, const RunSettings& settings,
                                          const TrainOptions& options);

/// Returns the contents of the policy file (docs/policy_file.md), with its golden pair.
std::string policy_contents(const PolicySnapshot& snapshot);

}  // namespace cale
