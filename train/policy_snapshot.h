// The policy file of a checkpoint: what the agent says of its policy, and what the run says.
#pragma once

#include <optional>
#include <string>

#include "agents/agent.h"
#include "policy/policy_info.h"
#include "settings/run_config.h"

namespace cale {

struct TrainingWorld;
struct TrainOptions;

/// What becomes a policy file.
struct PolicySnapshot {
    AgentPolicy agent;
    PolicyInfo info;  // all but what the agent says
};

/// Returns what a policy file says of a run, but for the step that it has come to; none of a world whose
/// policies have no file.
std::optional<PolicyInfo> run_policy_info(const TrainingWorld& world, const RunSettings& settings,
                                          const TrainOptions& options);

/// Returns the contents of the policy file (docs/policy_file.md), with its golden pair.
std::string policy_contents(const PolicySnapshot& snapshot);

}  // namespace cale
