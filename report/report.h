// A report as a folder of files.
#pragma once

#include <filesystem>
#include <vector>

#include "report/comparison.h"
#include "report/html.h"

namespace cale {

/// Writes report.html, every figure as .svg and .png and every table as .csv and, for papers, .tex to
/// `folder`, which is made if need be, in the place of an earlier report. Returns their paths, the page
/// first. `with_script`: see to_html(). Throws std::runtime_error that names a file which cannot be written,
/// or which has such a name and is no report's; what was there stays as it was then, unless
/// it is a file's moving into place that fails.
std::vector<std::filesystem::path> write_report(const Comparison& comparison, const PageOrigin& origin,
                                                const std::filesystem::path& folder,
                                                bool with_script = false);

}  // namespace cale
