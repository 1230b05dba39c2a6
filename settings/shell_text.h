// Command lines as they can be typed again.
#pragma once

#include <span>
#include <string>

namespace cale {

/// Returns arguments as text that a shell reads to the same arguments.
std::string shell_text(std::span<const std::string> arguments);

}  // namespace cale
