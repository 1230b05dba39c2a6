#include "experiment/agent_of_config.h"

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "experiment/run_config.h"

namespace cale {
namespace {

template <class AgentConfig>
bool takes(const std::filesystem::path& file) {
    RunConfig<AgentConfig> config;
    auto table = settings_of(config);
    try {
        table.load(file);
    } catch (const ConfigError&) {
        return false;
    }
    return true;
}

struct TrainProgram {
    const char* name;
    bool (*takes)(const std::filesystem::path& file);
};
constexpr TrainProgram kPrograms[] = {{"train_sac", takes<SacConfig>},
                                      {"train_sacd", takes<SacdConfig>},
                                      {"train_ppo", takes<PpoConfig>},
                                      {"train_dqn", takes<DqnConfig>},
                                      {"train_der", takes<DerConfig>}};

}  // namespace

std::vector<std::string> programs_that_take(const std::filesystem::path& config_file) {
    std::vector<std::string> names;
    for (const auto& program : kPrograms)
        if (program.takes(config_file)) names.emplace_back(program.name);
    return names;
}

}  // namespace cale
