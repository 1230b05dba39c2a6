#include "cale/control_groups.h"

#include <algorithm>
#include <fstream>
#include <string>

#include "cale/text.h"

namespace cale {
namespace fs = std::filesystem;

std::vector<ControlGroup> control_groups(const fs::path& root, std::string_view controller) {
    std::vector<ControlGroup> found;
    // Lines are "0::/path" (version 2) or "4:cpu,cpuacct:/path" (version 1). In a container the path may be
    // the host's; the group is then at the top.
    std::ifstream groups(root / "proc/self/cgroup");
    for (std::string line; std::getline(groups, line);) {
        const auto first = line.find(':');
        const auto second = line.find(':', first + 1);
        if (first == std::string::npos || second == std::string::npos) continue;
        const auto names = line.substr(first + 1, second - first - 1);
        const bool version_2 = names.empty();
        const auto controllers = split(names, ',');
        if (!version_2 && std::ranges::find(controllers, controller) == controllers.end()) continue;
        const fs::path top =
            version_2 ? root / "sys/fs/cgroup" : root / "sys/fs/cgroup" / fs::path(controller);
        for (fs::path group = fs::path(line.substr(second + 1)).relative_path();;
             group = group.parent_path()) {
            found.push_back({.folder = top / group, .version_2 = version_2});
            if (group.empty()) break;
        }
    }
    return found;
}

}  // namespace cale
