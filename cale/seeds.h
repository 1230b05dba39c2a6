// One seed per run, many independent streams.
#pragma once

#include <cstdint>
#include <string_view>

namespace cale {

/// The finaliser of splitmix64 (Steele et al. 2014).
constexpr std::uint64_t mixed(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

/// The next number of splitmix64 behind the state `z`.
constexpr std::uint64_t splitmix64(std::uint64_t z) {
    return mixed(z + 0x9E3779B97F4A7C15u);
}

/// A 31-bit seed for the `index`-th consumer called `name` (FNV-1a of the name, mixed with
/// seed and index by splitmix64's finaliser). 31 bits, as ALE reads its seeds as signed.
std::uint32_t derive_seed(std::uint64_t seed, std::string_view name, std::int64_t index);

}  // namespace cale
