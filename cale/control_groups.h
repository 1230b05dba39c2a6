// The control groups of Linux that limit what this process may take: containers, batch systems.
#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

namespace cale {

/// A control group of Linux, as containers have.
struct ControlGroup {
    std::filesystem::path folder;  // of its files, which need not be there
    bool version_2 = true;
};

/// The groups that this process is in for `controller` ("memory", "cpu"), each followed by those above it,
/// all of which limit it. `root` is the folder that holds proc/ and sys/.
std::vector<ControlGroup> control_groups(const std::filesystem::path& root, std::string_view controller);

}  // namespace cale
