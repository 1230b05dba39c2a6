#include "report/report.h"

#include <string>

#include "report/csv.h"
#include "report/figures.h"
#include "report/tables.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// Of an earlier report in the folder all that it may have written: what this one does not write would stand
/// beside it as if it did.
void remove_report(const fs::path& folder) {
    if (!fs::exists(folder / "report.html")) return;
    for (const auto* name : {"report", "scores", "run_curves", "setup", "settings", "aggregates",
                             "sample_efficiency", "performance_profiles", "probability_of_improvement",
                             "game_curves", "game_scores", "events", "zones", "rewards"}) {
        for (const auto* extension : {".html", ".csv", ".tex", ".svg", ".png"})
            fs::remove(folder / (std::string(name) + extension));
    }
}

}  // namespace

std::vector<fs::path> write_report(const Comparison& comparison, const PageOrigin& origin,
                                   const fs::path& folder, bool with_script) {
    fs::create_directories(folder);
    remove_report(folder);
    const auto pictures = figures(comparison);
    std::vector<fs::path> files{folder / "report.html"};
    for (const auto& tables : {csv_files(comparison), latex_files(comparison)}) {
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
    // Its links lead to what is there.
    write_text(files.front(), to_html(comparison, pictures, origin, with_script));
    return files;
}

}  // namespace cale
