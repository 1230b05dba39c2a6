// A policy file that every reader accepts: a small network whose weights are all zero.
#pragma once

#include <string>

#include "policy/policy_file.h"

namespace fuzz {

inline const std::string& good_policy() {
    static const std::string contents = [] {
        cale::PolicyFile file;
        file.info.game = "Pong";
        file.info.agent = "dqn";
        file.info.encoder = "phi_dqn";
        file.info.action_space = "full";
        for (int event = 0; event < 18; ++event) file.info.actions.push_back(static_cast<cale::Event>(event));
        file.network = {.encoder = cale::PolicyNetwork::Encoder::phi_dqn,
                        .branch = cale::PolicyNetwork::Branch::none,
                        .hidden_units = 1,
                        .head = cale::PolicyNetwork::Head::values,
                        .num_actions = 18};
        for (const auto& [name, type, shape] : cale::parameters_of(file.network)) {
            std::size_t count = 1;
            for (const auto size : shape) count *= static_cast<std::size_t>(size);
            file.weights[name].assign(count, 0);
        }
        file.golden = {
            .observation = cale::golden_observation(file.info),
            .output = std::vector<float>(static_cast<std::size_t>(cale::output_size(file.network)))};
        return cale::policy_file_contents(file);
    }();
    return contents;
}

}  // namespace fuzz
