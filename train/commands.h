// The subcommands of `cale`, a file each. A function adds one to the program; its callback, which
// runs when the command line named it, does the work. What it throws is printed as one sentence and
// ends the program with code 1; a callback that has another code to give stores it in `exit_code`.
#pragma once

#include <CLI/CLI.hpp>

namespace cale {

/// Where the time of a run went.
void add_bench(CLI::App& app);

}  // namespace cale
