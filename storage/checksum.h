// The checksum of TensorBoard's records and of a checkpoint's files.
#pragma once

#include <cstdint>
#include <string_view>

namespace cale {

/// CRC-32C (Castagnoli), as in iSCSI and TFRecord files. It detects accidental damage, not tampering.
std::uint32_t crc32c(std::string_view bytes);

}  // namespace cale
