#include "agents/state.h"

#include <stdexcept>
#include <utility>
#include <vector>

#include <torch/utils.h>

#include "agents/random.h"

namespace cale {

void StateParts::add(const std::string& prefix, const torch::nn::Module& module) {
    for (const auto& parameter : module.named_parameters())
        tensors[prefix + parameter.key()] = parameter.value().detach();
}

void StateParts::add(const std::string& prefix, const TensorMap& named) {
    for (const auto& [name, tensor] : named) tensors[prefix + name] = tensor.detach();
}

void add_part(TensorMap& state, const std::string& prefix, const TensorMap& named) {
    for (const auto& [name, tensor] : named) state[prefix + name] = tensor;
}

TensorMap part_of(const TensorMap& state, const std::string& prefix) {
    TensorMap part;
    for (const auto& [name, tensor] : state)
        if (name.starts_with(prefix)) part[name.substr(prefix.size())] = tensor;
    return part;
}

TensorMap saved(const StateParts& parts) {
    TensorMap state;
    for (const auto& [name, tensor] : parts.tensors)
        state[name] = tensor.to(torch::kCPU, /*non_blocking=*/false, /*copy=*/true);
    for (const auto& [name, generator] : parts.generators) state[name] = random_state(*generator);
    for (const auto& [name, engine] : parts.engines) state[name] = random_state(*engine);
    for (const auto& [name, counter] : parts.counters) state[name] = torch::tensor(*counter, torch::kInt64);
    return state;
}

void restore(const StateParts& parts, const TensorMap& state) {
    const torch::NoGradGuard no_grad;
    const auto stored = [&state](const std::string& name) {
        const auto found = state.find(name);
        if (found == state.end()) throw std::runtime_error("the agent's state lacks '" + name + "'");
        return found->second;
    };
    const auto refuse = [](const std::string& name) {
        throw std::runtime_error("'" + name + "' has another shape or type: of another configuration");
    };
    for (const auto& [name, tensor] : parts.tensors)
        if (stored(name).sizes() != tensor.sizes() || stored(name).dtype() != tensor.dtype()) refuse(name);
    for (const auto& [name, counter] : parts.counters)
        if (stored(name).numel() != 1 || stored(name).dtype() != torch::kInt64) refuse(name);
    // Everything is read before anything is changed.
    std::vector<std::pair<at::Generator*, at::Generator>> generators;
    std::vector<std::pair<std::mt19937_64*, std::mt19937_64>> engines;
    std::vector<std::pair<std::int64_t*, std::int64_t>> counters;
    for (const auto& [name, generator] : parts.generators)
        generators.emplace_back(generator, restored_generator(stored(name), generator->device()));
    for (const auto& [name, engine] : parts.engines)
        engines.emplace_back(engine, restored_engine(stored(name)));
    for (const auto& [name, counter] : parts.counters)
        counters.emplace_back(counter, stored(name).item<std::int64_t>());

    // In place, because others may hold the generator.
    for (const auto& [generator, value] : generators) generator->set_state(value.get_state());
    for (const auto& [engine, value] : engines) *engine = value;
    for (const auto& [counter, value] : counters) *counter = value;
    for (const auto& [name, tensor] : parts.tensors) tensor.copy_(stored(name));
}

}  // namespace cale
