#include "report/report.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
#include <unistd.h>

#include "cale/number.h"
#include "report/figures.h"
#include "report/tables.h"
#include "storage/files.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// Whether the folder has a page, and a report wrote it: its title says so.
bool has_report(const fs::path& folder) {
    std::string head(512, '\0');
    std::ifstream page(folder / "report.html", std::ios::binary);
    page.read(head.data(), static_cast<std::streamsize>(head.size()));
    return head.find("<title>CALE: ") != head.npos;
}

/// Whether it is Markdown that no report wrote, whose tables begin with '|': notes may be called like one.
bool is_notes(const fs::path& file) {
    return file.extension() == ".md" && std::ifstream(file).get() != '|';
}

/// The names of all files that reports have beside the page, with whatever runs.
std::vector<std::string> file_names() {
    std::vector<std::string> names{"scores.csv", "run_curves.csv"};
    const auto add = [&](std::string_view name, std::initializer_list<std::string_view> extensions) {
        for (const auto extension : extensions) names.push_back(fmt::format("{}{}", name, extension));
    };
    for (const auto* table : {"setup", "settings"}) add(table, {".csv", ".tex", ".md"});
    for (const auto* figure :
         {"sample_efficiency", "performance_profiles", "game_curves", "events", "zones", "rewards"})
        add(figure, {".csv", ".svg", ".png"});
    for (const auto both : kFiguresWithTable) add(both, {".csv", ".tex", ".md", ".svg", ".png"});
    return names;
}

/// Returns a file that a report with these names would replace or a later one remove, and that no earlier one
/// wrote, or empty. `reported`: whether there was one.
fs::path other_file(const fs::path& folder, const std::vector<std::string>& names, bool reported) {
    for (const auto& name : names)
        if (auto file = folder / name;
            fs::exists(file) && (!reported || is_notes(file) || fs::is_directory(file)))
            return file;
    if (!reported)
        for (const auto& name : file_names())
            if (auto file = folder / name; fs::exists(file) && !is_notes(file)) return file;
    return {};
}

constexpr std::string_view kPartial = ".partial-";

/// Removes what reports that were killed have left in a folder.
void remove_partial_folders(const fs::path& folder) {
    std::error_code ignored;
    std::vector<fs::path> abandoned;
    for (const auto& entry : fs::directory_iterator(folder, ignored)) {
        const auto name = entry.path().filename().string();
        if (!name.starts_with(kPartial)) continue;
        const auto process = number_in<::pid_t>(std::string_view(name).substr(kPartial.size()));
        if (process && ::kill(*process, 0) != 0 && errno == ESRCH) abandoned.push_back(entry.path());
    }
    for (const auto& path : abandoned) fs::remove_all(path, ignored);
}

/// A new folder of this process's that is gone at the end, with what is still in it.
class PartialFolder {
  public:
    explicit PartialFolder(const fs::path& parent)
        : path_(parent / fmt::format("{}{}", kPartial, ::getpid())) {
        remove_partial_folders(parent);
        fs::remove_all(path_);
        fs::create_directories(path_);
    }
    PartialFolder(const PartialFolder&) = delete;
    PartialFolder& operator=(const PartialFolder&) = delete;
    ~PartialFolder() {
        std::error_code ignored;
        fs::remove_all(path_, ignored);
    }
    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

}  // namespace

std::vector<fs::path> write_report(const Comparison& comparison, const PageOrigin& origin,
                                   const fs::path& folder, bool with_script) {
    const auto pictures = figures(comparison);
    // The whole report is written before any of it takes the place of an earlier one.
    const PartialFolder partial(folder);
    std::vector<std::string> names;
    const auto next = [&](const std::string& name) { return partial.path() / names.emplace_back(name); };
    write_file_atomically(next("report.html"), to_html(comparison, pictures, origin, with_script));
    for (const auto& tables : {csv_files(comparison), table_files(comparison)})
        for (const auto& table : tables) write_file_atomically(next(table.name), table.text);
    for (const auto& figure : pictures)
        for (const auto* extension : {".svg", ".png"})
            write_picture(figure.picture, next(figure.name + extension));

    const bool reported = has_report(folder);
    if (const auto other = other_file(folder, names, reported); !other.empty()) {
        throw std::runtime_error(
            fmt::format("{} is there and would be replaced, by this report or by another with more in it, "
                        "and no report has written it; write to another folder",
                        other.string()));
    }
    std::vector<fs::path> files;
    for (const auto& name : names) {
        files.push_back(folder / name);
        fs::rename(partial.path() / name, files.back());
    }
    if (!reported) return files;
    // What the earlier report had and this one has not would stand beside it as if it were its own.
    for (const auto& other : file_names())
        if (std::ranges::find(names, other) == names.end() && !is_notes(folder / other))
            fs::remove(folder / other);
    return files;
}

}  // namespace cale
