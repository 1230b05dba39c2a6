// A comparison as one self-contained HTML page, without network.
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
/// `with_script`: with a script in it that shows the values of curves under the pointer, switches groups off
/// and filters games; without scripts the page is the same as it is without.
std::string to_html(const Comparison& comparison, const std::vector<Figure>& figures,
                    const PageOrigin& origin, bool with_script = false);

}  // namespace cale
