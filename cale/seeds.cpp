#include "cale/seeds.h"

namespace cale {

namespace {

std::uint64_t mix(std::uint64_t z) {
    z += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

}  // namespace

std::uint32_t derive_seed(std::uint64_t seed, std::string_view name, std::int64_t index) {
    std::uint64_t hash = 0xCBF29CE484222325u;
    for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
    return static_cast<std::uint32_t>(mix(mix(seed ^ hash) + static_cast<std::uint64_t>(index)) >> 33);
}

}  // namespace cale
