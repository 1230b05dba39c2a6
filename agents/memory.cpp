#include "agents/memory.h"

#include <sstream>
#include <stdexcept>
#include <string>

namespace cale {

std::int64_t parameter_bytes(const torch::nn::Module& module) {
    std::int64_t bytes = 0;
    for (const auto& parameter : module.parameters()) bytes += parameter.numel() * parameter.element_size();
    return bytes;
}

std::int64_t memory_beside(const NetworkMemory& networks, const AgentSpec& spec, std::int64_t available) {
    const std::int64_t stored = networks.target ? 4 : 3;  // parameters, two moments, the target
    const std::int64_t copies = spec.device.is_cpu() ? 2 * stored + 1 : stored;
    const std::int64_t needed = copies * networks.parameters;
    if (needed <= available) return available - needed;
    refuse_memory("the network, with its gradients, Adam's moments and checkpoints,", needed, available,
                  "lower " + std::string(networks.settings));
}

std::int64_t memory_beside_batch(const BatchNetwork& network, std::int64_t batch_size, const AgentSpec& spec,
                                 std::int64_t available, std::string_view key) {
    const auto observation = spec.observation.stack * spec.observation.frame_size();
    auto needed = 2 * observation * batch_size;
    if (spec.device.is_cpu()) {
        std::int64_t units = 0;
        for (const auto& layer : sized_layers(network.acting))
            if (layer.kind == Layer::Kind::conv) units += layer.out.count();
        // A dense layer has as many numbers as its bias; a norm and a noisy layer are counted twice.
        for (const auto& parameter : network.whole.parameters())
            if (parameter.dim() == 1) units += parameter.numel();
        needed += (observation + 2 * units) * batch_size * (spec.precision == Precision::bf16 ? 2 : 4);
    }
    if (needed <= available) return available - needed;
    refuse_memory("a batch of " + std::to_string(batch_size), needed, available, "lower " + std::string(key));
}

void refuse_memory(std::string_view what, std::int64_t needed, std::int64_t available,
                   std::string_view way_out) {
    std::ostringstream message;
    message.precision(3);
    message << what << " needs " << static_cast<double>(needed) / 1e9 << " GB of memory and "
            << static_cast<double>(available) / 1e9 << " GB are available: " << way_out;
    throw std::runtime_error(message.str());
}

}  // namespace cale
