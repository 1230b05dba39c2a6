#include "agents/random.h"

#include <algorithm>
#include <sstream>
#include <stdexcept>
#include <string>

#include <ATen/CPUGeneratorImpl.h>
#include <torch/types.h>

namespace cale {

std::uint64_t stream_seed(std::uint64_t seed, std::uint64_t stream) {
    const auto mix = [](std::uint64_t z) {
        z += 0x9E3779B97F4A7C15u;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
        return z ^ (z >> 31);
    };
    return mix(mix(seed) + stream);
}

at::Generator make_generator(std::uint64_t seed, c10::Device device) {
    if (device.is_cpu()) return at::detail::createCPUGenerator(seed);
    auto generator =
        at::globalContext().getAcceleratorHooksInterface(device.type()).getNewGenerator(device.index());
    generator.set_current_seed(seed);
    return generator;
}

torch::Tensor random_state(const at::Generator& generator) {
    return generator.get_state();
}

torch::Tensor random_state(const std::mt19937_64& engine) {
    std::ostringstream text;
    text << engine;
    const auto bytes = text.str();
    auto state = torch::empty({static_cast<std::int64_t>(bytes.size())}, torch::kUInt8);
    std::copy(bytes.begin(), bytes.end(), state.data_ptr<std::uint8_t>());
    return state;
}

at::Generator restored_generator(const torch::Tensor& state, c10::Device device) {
    auto generator = make_generator(0, device);
    try {
        generator.set_state(state.cpu());
    } catch (const c10::Error&) {
        throw std::runtime_error("a stored random state of " + std::to_string(state.numel()) +
                                 " bytes is not one of LibTorch's generator on the " + device.str());
    }
    return generator;
}

std::mt19937_64 restored_engine(const torch::Tensor& state) {
    const auto bytes = state.to(torch::kCPU, torch::kUInt8).contiguous();
    const auto* first = bytes.data_ptr<std::uint8_t>();
    std::istringstream text(std::string(first, first + bytes.numel()));
    std::mt19937_64 engine;
    text >> engine;
    if (!text) {
        throw std::runtime_error("a stored random state of " + std::to_string(state.numel()) +
                                 " bytes is not one of std::mt19937_64");
    }
    return engine;
}

}  // namespace cale
