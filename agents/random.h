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

/// A generator on the CPU: what is drawn does not depend on the device that trains.
at::Generator make_generator(std::uint64_t seed);

/// A generator's state as uint8 [bytes], and back. Loading throws std::runtime_error for
/// bytes that are no such state.
torch::Tensor random_state(const at::Generator& generator);
torch::Tensor random_state(const std::mt19937_64& engine);
void load_random_state(at::Generator& generator, const torch::Tensor& state);
void load_random_state(std::mt19937_64& engine, const torch::Tensor& state);

}  // namespace cale
