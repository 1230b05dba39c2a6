#include "train/policy_snapshot.h"

#include <algorithm>
#include <string_view>

#include "cale/text.h"
#include "policy/inference_plan.h"
#include "policy/policy_file.h"
#include "settings/versions.h"
#include "train/training.h"
#include "train/training_world.h"

namespace cale {
namespace {

/// A run's configuration without comments and without the folder of the ROMs.
std::string without_comments(const std::string& yaml) {
    std::string result;
    for (const auto& line : split(yaml, '\n')) {
        const auto text = std::string_view(line).substr(std::min(line.find_first_not_of(' '), line.size()));
        if (!text.empty() && text.front() != '#' && !text.starts_with("rom_dir:")) result += line + "\n";
    }
    return result;
}

}  // namespace

std::optional<PolicyInfo> run_policy_info(const TrainingWorld& world, const RunSettings& settings,
                                          const TrainOptions& options) {
    if (!world.policy_info) return std::nullopt;
    auto info = world.policy_info();
    info.agent = options.agent_name;
    for (const auto& [key, value] : options.hyperparameters)
        if (key == "agent.encoder") info.encoder = value;
    info.provenance = {{"seed", std::to_string(settings.train.seed)},
                       {"cale", std::string(cale_version())},
                       {"ale", std::string(ale_version())},
                       {"libtorch", std::string(torch_version())},
                       {"config", without_comments(options.config)}};
    return info;
}

std::map<std::string, std::vector<float>> numbers_of(const TensorMap& weights) {
    std::map<std::string, std::vector<float>> all;
    for (const auto& [name, tensor] : weights) {
        const float* const numbers = tensor.const_data_ptr<float>();
        all[name].assign(numbers, numbers + tensor.numel());
    }
    return all;
}

std::string policy_contents(const PolicySnapshot& snapshot) {
    PolicyFile file{.info = snapshot.info,
                    .network = snapshot.agent.network,
                    .weights = numbers_of(snapshot.agent.weights),
                    .golden = {}};
    file.info.evaluation_samples = snapshot.agent.samples;
    file.info.epsilon = snapshot.agent.epsilon;
    set_observation(file.info, file.network.observation);
    set_golden_pair(file);
    return policy_file_contents(file);
}

}  // namespace cale
