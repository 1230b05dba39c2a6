// How `cale` and its subcommands print --help.
#pragma once

#include <memory>

#include <CLI/CLI.hpp>

namespace cale {

/// Names on the left, sentences wrapped to the terminal on the right, defaults at their ends: the same as
/// the help of the training programs. To be given to the program before its subcommands are added.
std::shared_ptr<CLI::FormatterBase> help_formatter();

}  // namespace cale
