#include "report/report.h"

#include <string>

#include "report/csv.h"
#include "report/figures.h"
#include "report/tables.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// Removes the files beside the page of an earlier report in the folder: those that the new one does not have
/// would stand beside it as if they were its own.
void remove_report(const fs::path& folder) {
    if (!fs::exists(folder / "report.html")) return;
    for (const auto* name : {"scores", "run_curves", "setup", "settings", "aggregates", "sample_efficiency",
                             "performance_profiles", "probability_of_improvement", "game_curves",
                             "game_scores", "events", "zones", "rewards"}) {
        for (const auto* extension : {".csv", ".tex", ".svg", ".png"})
            fs::remove(folder / (std::string(name) + extension));
    }
}

}  // namespace

std::vector<fs::path> write_report(const Comparison& comparison, const PageOrigin& origin,
                                   const fs::path& folder, bool with_script) {
    fs::create_directories(folder);
    const auto pictures = figures(comparison);
    const auto page = to_html(comparison, pictures, origin, with_script);
    const auto all_tables = {csv_files(comparison), latex_files(comparison)};
    remove_report(folder);
    std::vector<fs::path> files{folder / "report.html"};
    write_text(files.front(), page);
    for (const auto& tables : all_tables) {
        for (const auto& table : tables) {
            files.push_back(folder / table.name);
            write_text(files.back(), table.text);
        }
    }
    for (const auto& figure : pictures) {
        for (const auto* extension : {".svg", ".png"}) {
            files.push_back(folder / (figure.name + extension));
            write_picture(figure.picture, files.back());
        }
    }
    return files;
}

}  // namespace cale
