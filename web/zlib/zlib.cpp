#include "zlib.h"

#include <array>
#include <cstdint>

namespace {

constexpr std::array<std::uint32_t, 256> kRemainders = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t byte = 0; byte < table.size(); ++byte) {
        std::uint32_t remainder = byte;
        for (int bit = 0; bit < 8; ++bit)
            remainder = (remainder >> 1) ^ ((remainder & 1) != 0 ? 0xEDB88320U : 0);
        table[byte] = remainder;
    }
    return table;
}();

}  // namespace

uLong crc32(uLong crc, const Bytef* bytes, uInt count) {
    auto remainder = ~static_cast<std::uint32_t>(crc);
    for (uInt i = 0; i < count; ++i)
        remainder = (remainder >> 8) ^ kRemainders[(remainder ^ bytes[i]) & 0xFF];
    return ~remainder;
}

int compress(Bytef*, uLongf*, const Bytef*, uLong) {
    return Z_MEM_ERROR;
}

gzFile gzopen(const char* path, const char* mode) {
    return std::fopen(path, mode);
}
int gzread(gzFile file, void* to, unsigned count) {
    return static_cast<int>(std::fread(to, 1, count, file));
}
int gzclose(gzFile file) {
    return std::fclose(file);
}
