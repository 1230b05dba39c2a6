#include "settings/agent_of_config.h"

#include <memory>

#include <all_agents.h>

#include "settings/run_config.h"

namespace cale {
namespace {

template <class AgentConfig>
bool takes(const std::filesystem::path& file,
           std::unique_ptr<Agent> (*)(const AgentConfig&, const AgentSpec&)) {
    RunConfig<AgentConfig> config;
    auto table = settings_of(config);
    try {
        table.load(file);
    } catch (const ConfigError&) {
        return false;
    }
    return true;
}

}  // namespace

std::vector<std::string> programs_that_take(const std::filesystem::path& config_file) {
    std::vector<std::string> names;
    for_each_agent([&](const std::string& agent, auto make_agent) {
        if (takes(config_file, make_agent)) names.push_back("train_" + agent);
    });
    return names;
}

}  // namespace cale
