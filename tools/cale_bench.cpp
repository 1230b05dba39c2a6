#include <cstdio>
#include <memory>
#include <string>

#include "tools/commands.h"
#include "train/time_report.h"

namespace cale {

void add_bench(CLI::App& app) {
    auto& command = *app.add_subcommand("bench",
                                        "Shows where a run spent its time: environment, replay, transfer to "
                                        "the device, choosing actions, updates, evaluations, logs.");
    const auto run_dir = std::make_shared<std::string>();
    command.add_option("RUN", *run_dir, "the folder of a run, finished or under way")
        ->required()
        ->type_name("RUN");
    command.footer(
        "Examples:\n"
        "  cale bench runs/Breakout__sac__1__1795270400\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([run_dir] { std::fputs(time_report(*run_dir).c_str(), stdout); });
}

}  // namespace cale
