// What this program was built from.
#pragma once

#include <string_view>

namespace cale {

std::string_view cale_version();   // "0.1.0"
std::string_view torch_version();  // LibTorch's, "2.11.0"
std::string_view ale_version();    // the emulator's, "0.12.1"

}  // namespace cale
