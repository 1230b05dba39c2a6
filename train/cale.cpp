// cale: what is done with runs beside training them.
#include <cstdio>
#include <exception>
#include <string>

#include <CLI/CLI.hpp>

#include "experiment/time_report.h"
#include "experiment/versions.h"

int main(int argc, char** argv) {
    CLI::App app("What is done with runs beside training them.", "cale");
    app.set_version_flag("--version", std::string(cale::cale_version()));
    app.require_subcommand(1);

    std::string run_dir;
    auto& bench = *app.add_subcommand("bench",
                                      "Says where the time of a run went: environment, replay, "
                                      "transfer to the device, choosing actions, updates, logs.");
    bench.add_option("RUN", run_dir, "the folder of a run, finished or under way")->required();

    try {
        app.parse(argc, argv);
        if (bench) std::fputs(cale::time_report(run_dir).c_str(), stdout);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "cale: %s\n", error.what());
        return 1;
    }
    return 0;
}
