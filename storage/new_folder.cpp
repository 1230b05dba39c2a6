#include "storage/new_folder.h"

#include <string>
#include <system_error>
#include <utility>

namespace cale {
namespace fs = std::filesystem;

namespace {

/// The folders on the way to `path` that are not there, from the top.
std::vector<fs::path> missing_folders(const fs::path& path) {
    std::vector<fs::path> missing;
    fs::path folder;
    for (const auto& part : path)
        if (!fs::exists(folder /= part)) missing.push_back(folder);
    return missing;
}

}  // namespace

NewFolder::NewFolder(fs::path path, std::vector<fs::path> created)
    : path_(std::move(path)), created_(std::move(created)) {}

NewFolder::NewFolder(const fs::path& path)
    : path_((path / "").parent_path()), created_(missing_folders(path_)) {
    fs::create_directories(path_);
}

NewFolder NewFolder::with_a_free_name(const fs::path& path) {
    auto created = missing_folders(path.parent_path());
    if (path.has_parent_path()) fs::create_directories(path.parent_path());
    for (int number = 1;; ++number) {
        const auto name = number == 1 ? path : fs::path(path.string() + "_" + std::to_string(number));
        if (!fs::create_directory(name)) continue;
        created.push_back(name);
        return {name, std::move(created)};
    }
}

NewFolder::~NewFolder() {
    std::error_code refused;  // of a folder that is not empty, and of one with "..", which is another one
    for (auto folder = created_.rbegin(); folder != created_.rend(); ++folder) fs::remove(*folder, refused);
}

NewFolder::NewFolder(NewFolder&&) noexcept = default;  // leaves the other one none to remove

}  // namespace cale
