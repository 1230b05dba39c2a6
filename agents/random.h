// Independent streams of random numbers from one seed, and how they are stored.
#pragma once

#include <cstdint>
#include <random>

#include <ATen/core/Generator.h>
#include <torch/types.h>

namespace cale {

/// The seed of stream number `stream` of a run with this `seed`: splitmix64's output function
/// (Steele et al. 2014), so that neighbouring seeds and streams have nothing in common.
std::uint64_t stream_seed(std::uint64_t seed, std::uint64_t stream);

/// Returns a generator of random numbers on this device. Those of the CPU do not depend on the device that
/// trains; those of that device need not be copied to it.
at::Generator make_generator(std::uint64_t seed, c10::Device device = c10::DeviceType::CPU);

/// A generator's state as uint8 [bytes].
torch::Tensor random_state(const at::Generator& generator);
/// The same for an engine of the standard library.
torch::Tensor random_state(const std::mt19937_64& engine);

/// The generators that such states are of, the first on `device`, where a state of the other kind of device
/// seeds one. Both throw std::runtime_error for other bytes.
at::Generator restored_generator(const torch::Tensor& state, c10::Device device = c10::DeviceType::CPU);
/// See restored_generator().
std::mt19937_64 restored_engine(const torch::Tensor& state);

}  // namespace cale
