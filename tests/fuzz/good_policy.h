// A policy file that every reader accepts: a small network whose weights are all zero.
#pragma once

#include <string>

#include "policy/encoder_layers.h"
#include "policy/network_parameters.h"
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
        file.network = {.layers = cale::chain(
                            {cale::prefixed("encoder.", cale::phi_dqn()),
                             {cale::Layer::dense("head.fc1", 1), cale::Layer::of(cale::Layer::Kind::relu)}}),
                        .head = {.kind = cale::Head::Kind::values, .num_actions = 18}};
        for (const auto& [name, shape] : cale::parameter_shapes(file.network)) {
            std::size_t count = 1;
            for (const auto size : shape) count *= static_cast<std::size_t>(size);
            file.weights[name].assign(count, 0);
        }
        file.golden = {
            .observation = cale::golden_observation(file.info),
            .output = std::vector<float>(static_cast<std::size_t>(cale::output_size(file.network.head)))};
        return cale::policy_file_contents(file);
    }();
    return contents;
}

}  // namespace fuzz
