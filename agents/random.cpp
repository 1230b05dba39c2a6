#include "agents/random.h"

#include <sstream>
#include <stdexcept>
#include <string>

#include <ATen/CPUGeneratorImpl.h>

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
    auto bytes = text.str();
    return torch::from_blob(bytes.data(), {std::ssize(bytes)}, torch::kUInt8).clone();
}

at::Generator restored_generator(const torch::Tensor& state, c10::Device device) {
    auto generator = make_generator(0, device);
    // The other kind's bytes: of a Philox on CUDA devices, of a Mersenne twister on the CPU.
    const bool from_elsewhere = state.numel() == (device.is_cpu() ? 16 : 5056);
    try {
        if (from_elsewhere)
            generator.set_current_seed(state.cpu().view(torch::kInt64).sum().item<std::int64_t>());
        else
            generator.set_state(state.cpu());
    } catch (const c10::Error&) {
        throw std::runtime_error("a stored random state of " + std::to_string(state.numel()) +
                                 " bytes is not one of LibTorch's generator on the " + device.str());
    }
    return generator;
}

std::mt19937_64 restored_engine(const torch::Tensor& state) {
    const auto bytes = state.to(torch::kCPU, torch::kUInt8).contiguous();
    std::istringstream text(
        {static_cast<const char*>(bytes.const_data_ptr()), static_cast<std::size_t>(bytes.numel())});
    if (std::mt19937_64 engine; text >> engine) return engine;
    throw std::runtime_error("a stored random state of " + std::to_string(state.numel()) +
                             " bytes is not one of std::mt19937_64");
}

}  // namespace cale
