#include "cale/seeds.h"

namespace cale {

std::uint32_t derive_seed(std::uint64_t seed, std::string_view name, std::int64_t index) {
    std::uint64_t hash = 0xCBF29CE484222325u;
    for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
    return static_cast<std::uint32_t>(
        splitmix64(splitmix64(seed ^ hash) + static_cast<std::uint64_t>(index)) >> 33);
}

}  // namespace cale
