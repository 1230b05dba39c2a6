#include "report/report.h"

#include "report/csv.h"
#include "report/figures.h"
#include "report/tables.h"

namespace cale {
namespace fs = std::filesystem;

std::vector<fs::path> write_report(const Comparison& comparison, const PageOrigin& origin,
                                   const fs::path& folder, bool with_script) {
    fs::create_directories(folder);
    const auto pictures = figures(comparison);
    std::vector<fs::path> files{folder / "report.html"};
    write_text(files.front(), to_html(comparison, pictures, origin, with_script));
    for (const auto& figure : pictures) {
        for (const auto* extension : {".svg", ".png"}) {
            files.push_back(folder / (figure.name + extension));
            write_picture(figure.picture, files.back());
        }
    }
    for (const auto& tables : {csv_files(comparison), latex_files(comparison)}) {
        for (const auto& table : tables) {
            files.push_back(folder / table.name);
            write_text(files.back(), table.text);
        }
    }
    return files;
}

}  // namespace cale
