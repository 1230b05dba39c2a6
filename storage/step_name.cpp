#include "storage/step_name.h"

#include <algorithm>
#include <system_error>

#include <fmt/format.h>

#include "cale/text.h"

namespace cale {

std::string step_name(std::int64_t step) {
    return fmt::format("step_{:09}", step);
}

std::optional<std::int64_t> step_in(const std::filesystem::path& path, std::string_view ending) {
    constexpr std::string_view kBeginning = "step_";
    const auto file = path.filename();
    std::string_view name = file.native();
    if (!name.starts_with(kBeginning) || !name.ends_with(ending)) return std::nullopt;
    name.remove_prefix(kBeginning.size());
    if (name.size() < ending.size()) return std::nullopt;
    name.remove_suffix(ending.size());
    if (name.find_first_not_of("0123456789") != name.npos) return std::nullopt;  // a sign, which is no digit
    return number_in<std::int64_t>(name);
}

std::vector<std::filesystem::path> named_by_step(const std::filesystem::path& folder,
                                                 std::string_view ending) {
    std::vector<std::filesystem::path> found;
    if (!std::filesystem::is_directory(folder)) return found;
    const auto step = [&](const auto& path) { return step_in(path, ending); };
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (step(entry.path())) found.push_back(entry.path());
    std::ranges::sort(found, {}, step);
    return found;
}

std::optional<std::int64_t> newest_step(const std::filesystem::path& folder, std::string_view ending) {
    std::optional<std::int64_t> newest;
    std::error_code ignored;
    for (const auto& item : std::filesystem::directory_iterator(folder, ignored))
        newest = std::max(newest, step_in(item.path(), ending));
    return newest;
}

}  // namespace cale
