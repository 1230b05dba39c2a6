#include "tools/train_programs.h"

#include <all_agents.h>

namespace cale {

std::vector<CommandWords> train_programs() {
    std::vector<CommandWords> programs;
    for_each_agent([&](const std::string& agent, auto make_agent) {
        programs.push_back(train_words(agent, make_agent));
    });
    return programs;
}

}  // namespace cale
