// What this program was built from.
#pragma once

#include <string_view>

namespace cale {

std::string_view cale_version();  // "0.1.0"
/// The commit of the sources, with "-dirty" where files differed from it: "0f1eed93a1b2-dirty"; "unknown"
/// where they were not in a git checkout of their own.
std::string_view cale_commit();
std::string_view torch_version();  // LibTorch's, "2.11.0"
std::string_view ale_version();    // the emulator's, "0.12.1"

}  // namespace cale
