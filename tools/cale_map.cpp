#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "cale/fields.h"
#include "cale/joystick.h"
#include "report/joystick_map.h"
#include "tools/commands.h"
#include "tools/usage.h"

namespace cale {

void add_map(CLI::App& app) {
    auto& command = *app.add_subcommand("map",
                                        "Draws which joystick event an action (r, theta, fire) stands for: "
                                        "the nine regions of the stick's disc, without fire and with it.");
    struct Options {
        double threshold = 0.5;
        std::string joystick = "polar";
        std::string output{};
    };
    const auto options = std::make_shared<Options>();
    command
        .add_option("--threshold", options->threshold,
                    "tau: how far the stick must be pushed to count, as a part of its radius")
        ->transform(numbers(0, 1))
        ->type_name("TAU");
    const auto joysticks = names_of(Joystick{});
    std::vector<std::string> names(joysticks.begin(), joysticks.end());
    std::erase(names, name_of(Joystick::paddle));  // which is placed, and has no regions
    command
        .add_option("--joystick", options->joystick,
                    "coordinates of the random actions whose shares are given, as env.joystick")
        ->transform(one_of(names))
        ->type_name("NAME");
    command
        .add_option("-o,--output", options->output,
                    "the picture's file, .svg or .png; without it the map is printed as text")
        ->type_name("FILE");
    command.footer(
        "Examples:\n"
        "  cale map\n"
        "  cale map --threshold 0.9 -o map.svg\n"
        "  cale map --joystick cartesian\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] {
        const auto all = names_of(Joystick{});
        const auto joystick = static_cast<Joystick>(std::ranges::find(all, options->joystick) - all.begin());
        if (options->output.empty()) {
            std::fputs(joystick_map_text(options->threshold, joystick).c_str(), stdout);
        } else {
            check_picture_file("--output", options->output);
            write_picture(joystick_map(options->threshold, joystick), options->output);
            std::printf("%s\n", options->output.c_str());
        }
    });
}

}  // namespace cale
