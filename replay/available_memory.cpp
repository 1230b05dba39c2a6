#include "replay/available_memory.h"

#include <algorithm>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>

#include "cale/control_groups.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

// The number after `key` in a file of "key value" lines.
std::optional<std::int64_t> number_of(const fs::path& file, const std::string& key) {
    std::ifstream lines(file);
    std::string word;
    std::int64_t value = 0;
    while (lines >> word) {
        if (word == key && lines >> value) return value;
        lines.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    }
    return {};
}

// Returns the number in a file that contains only it; none for "max".
std::optional<std::int64_t> number_in(const fs::path& file) {
    std::int64_t value = 0;
    if (std::ifstream(file) >> value) return value;
    return {};
}

// What is left of the address space that the process may have (`ulimit -v`); none if it has no limit.
std::optional<std::int64_t> left_of_address_space(const fs::path& process) {
    constexpr std::string_view kLimit = "Max address space";
    std::ifstream limits(process / "limits");
    for (std::string line; std::getline(limits, line);) {
        std::int64_t most = 0;
        if (!line.starts_with(kLimit) || !(std::istringstream(line.substr(kLimit.size())) >> most)) continue;
        const auto kibibytes = number_of(process / "status", "VmSize:");
        if (kibibytes) return std::max<std::int64_t>(most - *kibibytes * 1024, 0);
    }
    return {};
}

// What is left below the limit of this group. Its page cache is given up on demand, so it is left, too.
std::optional<std::int64_t> left_in_group(const fs::path& group, const char* limit, const char* usage) {
    const auto most = number_in(group / limit);
    const auto used = number_in(group / usage);
    if (!most || !used) return {};
    const std::int64_t cache = number_of(group / "memory.stat", "inactive_file").value_or(0) +
                               number_of(group / "memory.stat", "active_file").value_or(0);
    return std::max<std::int64_t>(*most - std::max<std::int64_t>(*used - cache, 0), 0);
}

}  // namespace

std::int64_t available_memory(const fs::path& root) {
    auto least = std::numeric_limits<std::int64_t>::max();
    const auto consider = [&least](std::optional<std::int64_t> bytes) {
        if (bytes) least = std::min(least, *bytes);
    };
    if (const auto kibibytes = number_of(root / "proc/meminfo", "MemAvailable:")) consider(*kibibytes * 1024);
    consider(left_of_address_space(root / "proc/self"));

    for (const auto& [group, version_2] : control_groups(root, "memory")) {
        consider(version_2 ? left_in_group(group, "memory.max", "memory.current")
                           : left_in_group(group, "memory.limit_in_bytes", "memory.usage_in_bytes"));
    }
    return least;
}

}  // namespace cale
