#include <cstdio>
#include <memory>
#include <string>

#include "play/stick_fit.h"
#include "tools/commands.h"
#include "tools/usage.h"

namespace cale {
namespace {

struct Options {
    std::string log;
    std::string output;
};

void run(const Options& options) {
    const auto log = read_stick_log(options.log);
    if (!options.output.empty()) check_picture_file("--output", options.output);
    const auto fit = fit_stick(log);
    std::fputs(stick_fit_text(log, fit).c_str(), stdout);
    if (options.output.empty()) return;
    write_picture(stick_fit_picture(log, fit), options.output);
    std::fprintf(stderr, "%s\n", options.output.c_str());
}

}  // namespace

void add_fit_stick(CLI::App& app) {
    auto& command = *app.add_subcommand("fit-stick",
                                        "Finds the speed, the damping and the latency of a real joystick "
                                        "from a log of commanded and measured positions, and prints them as "
                                        "settings of the environment.");
    const auto options = std::make_shared<Options>();
    command
        .add_option("LOG", options->log,
                    "a CSV file with the columns seconds, command_x, command_y, x, y: positions in radii of "
                    "the stick's travel, which begins at rest in the centre")
        ->required()
        ->type_name("LOG.csv");
    command.add_option("-o,--output", options->output, "a picture of the log and its fit, .svg or .png")
        ->type_name("FILE");
    command.footer(
        "Examples:\n"
        "  cale fit-stick robot.csv -o fit.svg\n"
        "  cale fit-stick robot.csv > my_robot.yaml\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] { run(*options); });
}

}  // namespace cale
