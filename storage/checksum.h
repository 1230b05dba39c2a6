// The checksum of TensorBoard's records and of a checkpoint's files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace cale {

/// CRC-32C (Castagnoli), as in iSCSI and TFRecord files. It detects accidental damage, not tampering.
std::uint32_t crc32c(std::string_view bytes);

/// As it is written into files: "5ef2a0c1".
std::string checksum_text(std::uint32_t checksum);

}  // namespace cale
