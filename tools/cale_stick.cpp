#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "cale/env.h"
#include "play/stick_fit.h"
#include "settings/config.h"
#include "tools/commands.h"
#include "tools/usage.h"

namespace cale {
namespace {

struct Options {
    std::string config;
    std::vector<std::string> settings;
    std::int64_t frames = 32;
    std::string output;
};

void run(const Options& options) {
    EnvConfig env;
    if (!options.config.empty()) load_environment(env, options.config);
    set_environment(env, options.settings);
    static_cast<void>(games_of(env.game));
    if (env.paddle == Paddle::absolute)
        throw ConfigError("env.paddle=absolute: the paddle is placed, and no stick moves it; leave it out");
    check(env.motion);
    if (options.output.empty()) {
        std::fputs(step_response_text(env, options.frames).c_str(), stdout);
        return;
    }
    check_picture_file("--output", options.output);
    write_picture(step_response_picture(env, options.frames), options.output);
    std::printf("%s\n", options.output.c_str());
}

}  // namespace

void add_stick(CLI::App& app) {
    auto& command =
        *app.add_subcommand("stick",
                            "Shows the step response of a joystick, commanded to the right with the button "
                            "pressed and then back to "
                            "the centre: its position after each frame and the event that the console sees. "
                            "A latency that is drawn is the longest.");
    const auto options = std::make_shared<Options>();
    command
        .add_option("--config", options->config,
                    "a YAML file with settings env.* alone, such as those in configs/env")
        ->type_name("FILE");
    command
        .add_option("--set", options->settings,
                    "change a setting of the joystick: env.stick_speed, env.action_latency, ...")
        ->allow_extra_args(false)
        ->take_all()
        ->type_name("KEY=VALUE");
    command
        .add_option("--frames", options->frames,
                    "how long it is commanded to the right, in frames of 1/60 s, rounded up to "
                    "agent steps (env.frame_skip)")
        ->transform(whole_numbers(1, 1000))
        ->type_name("N");
    command
        .add_option("-o,--output", options->output,
                    "the picture's file, .svg or .png; without it a table is printed")
        ->type_name("FILE");
    command.footer(
        "Examples:\n"
        "  cale stick --set env.stick_speed=0.2\n"
        "  cale stick --config configs/env/robot_servo.yaml -o step.svg\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] { run(*options); });
}

}  // namespace cale
