// One seed per run, many independent streams.
#pragma once

#include <cstdint>
#include <string_view>

namespace cale {

/// A 31-bit seed for the `index`-th consumer called `name` (FNV-1a of the name, mixed with
/// seed and index by splitmix64's finaliser). 31 bits, as ALE reads its seeds as signed.
std::uint32_t derive_seed(std::uint64_t seed, std::string_view name, std::int64_t index);

}  // namespace cale
