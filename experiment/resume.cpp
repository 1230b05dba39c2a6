#include "experiment/resume.h"

#include <algorithm>
#include <charconv>
#include <string>
#include <system_error>

namespace cale {
namespace fs = std::filesystem;

namespace {

/// "step_000250000" or "step_000250000.csv" as 250000.
std::optional<std::int64_t> step_in(std::string name, std::string_view ending) {
    if (!name.starts_with("step_") || !name.ends_with(ending)) return std::nullopt;
    name = name.substr(5, name.size() - 5 - ending.size());
    std::int64_t step = 0;
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), step);
    if (error != std::errc{} || end != name.data() + name.size()) return std::nullopt;
    return step;
}

}  // namespace

std::optional<std::int64_t> newest_step(const fs::path& folder, std::string_view ending) {
    std::optional<std::int64_t> newest;
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored))
        newest = std::max(newest, step_in(item.path().filename(), ending));
    return newest;
}

}  // namespace cale
