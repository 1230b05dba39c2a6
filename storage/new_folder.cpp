#include "storage/new_folder.h"

#include <string>
#include <system_error>
#include <utility>

namespace cale {
namespace fs = std::filesystem;

namespace {

/// The topmost of the folders that are not there and lead to `path`; empty: all are there.
fs::path topmost_missing(fs::path path) {
    fs::path missing;
    for (; !path.empty() && !fs::exists(path); path = path.parent_path()) missing = path;
    return missing;
}

}  // namespace

NewFolder::NewFolder(fs::path path, fs::path topmost)
    : path_(std::move(path)), topmost_(std::move(topmost)) {}

/// Without a slash at its end `path` has the parents that its folders have.
NewFolder::NewFolder(const fs::path& path)
    : path_((path / "").parent_path()), topmost_(topmost_missing(path_)) {
    fs::create_directories(path_);
}

NewFolder NewFolder::with_a_free_name(const fs::path& path) {
    const auto missing = topmost_missing(path.parent_path());
    if (path.has_parent_path()) fs::create_directories(path.parent_path());
    for (int number = 1;; ++number) {
        const auto name = number == 1 ? path : fs::path(path.string() + "_" + std::to_string(number));
        if (fs::create_directory(name)) return {name, missing.empty() ? name : missing};
    }
}

NewFolder::~NewFolder() {
    if (topmost_.empty()) return;
    std::error_code refused;  // of a folder that is not empty
    for (auto folder = path_; fs::remove(folder, refused) && folder != topmost_;)
        folder = folder.parent_path();
}

NewFolder::NewFolder(NewFolder&& other) noexcept
    : path_(std::move(other.path_)), topmost_(std::exchange(other.topmost_, {})) {}

}  // namespace cale
