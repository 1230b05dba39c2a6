// The output of `cale evaluate`.
#pragma once

#include <filesystem>
#include <string>

#include "evaluate/evaluation.h"
#include "policy/policy_info.h"

namespace cale {

/// An evaluation, with everything that determined it.
struct EvaluationReport {
    std::string source{};    // the path that the user gave
    std::string protocol{};  // "fixed_episodes" or "fixed_steps"
    bool sampled = false;
    std::string policy_checksum{};  // checksum_text() of the policy file
    std::string device = "cpu";     // on which the policy was computed, by LibTorch's threads
    const PolicyInfo& policy;
    const EvaluationPlan& plan;
    const Evaluation& evaluation;
};

/// Returns the text for the terminal: policy, game and protocol, the statistics of the returns, and the
/// joystick events.
std::string evaluation_text(const EvaluationReport& report);

/// Writes `name`.csv, `name`_events.csv and `name`_rewards.csv (write_evaluation), and at last
/// `name`.json with the settings and the statistics, to a folder that is made if need be.
void write_evaluation_report(const std::filesystem::path& folder, const EvaluationReport& report,
                             const std::string& name = "evaluation");

}  // namespace cale
