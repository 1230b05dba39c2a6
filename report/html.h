// A comparison as one self-contained HTML page: no network, no script.
#pragma once

#include <string>
#include <vector>

#include "report/comparison.h"
#include "report/figures.h"

namespace cale {

/// How the page was made, so that it can be reproduced.
struct PageOrigin {
    std::string command{};  // as it was typed
    std::string version{};  // of this program
    std::string time{};     // of making the page
};

/// Figures as inline SVG, in light or dark as the reader's system has it; tables; what was left out
/// and why; the settings in which groups differ; origin and methods.
std::string to_html(const Comparison& comparison, const std::vector<Figure>& figures,
                    const PageOrigin& origin);

}  // namespace cale
