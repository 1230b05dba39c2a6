// cale: what is done with runs beside training them.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "settings/command_line.h"
#include "settings/config.h"
#include "terminal/exit_code.h"
#include "terminal/failure.h"
#include "terminal/standard_output.h"
#include "tools/commands.h"
#include "tools/help.h"
#include "tools/usage.h"

namespace {

/// `cale help` and `cale help COMMAND` are `cale --help` and `cale COMMAND --help`.
std::vector<std::string> arguments_of(int argc, char** argv) {
    std::vector<std::string> words(argv + 1, argv + argc);
    if (!words.empty() && words.front() == "help") {
        words.erase(words.begin());
        words.emplace_back("--help");
    }
    return words;
}

void run(CLI::App& app, std::vector<std::string> words) {
    cale::check_first_word(app, words.front());
    cale::check_option_values(words);
    std::ranges::reverse(words);  // as CLI11 wants them
    try {
        app.parse(std::move(words));
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() != 0) throw cale::ConfigError(cale::usage_sentence(app, error));
        app.exit(error);  // prints what --help and --version ask for
    }
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): before the try block only memory can be short.
int main(int argc, char** argv) {
    cale::open_standard_streams();
    CLI::App app(
        "Sweeps, evaluation, play, reports and export for agents on the Continuous Arcade Learning "
        "Environment.",
        "cale");
    app.set_version_flag("--version", cale::version_text("cale"));
    app.require_subcommand(1);
    app.formatter(cale::help_formatter());
    app.option_defaults()->always_capture_default();
    app.footer(
        "`cale COMMAND --help` says more, with examples.\n"
        "Agents are trained by train_sac, train_sacd, train_ppo, train_dqn and train_der.\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage, 130 interrupted (evaluate, play, sweep).");
    int exit_code = cale::kDone;
    cale::add_bench(app);
    cale::add_completion(app);
    cale::add_evaluate(app, exit_code);
    cale::add_export(app);
    cale::add_fit_stick(app);
    cale::add_games(app);
    cale::add_map(app);
    cale::add_play(app, exit_code);
    cale::add_report(app);
    cale::add_stick(app);
    cale::add_sweep(app, exit_code);
    cale::refuse_forgotten_values(app);

    const auto words = arguments_of(argc, argv);
    if (words.empty()) {
        std::fputs(app.help().c_str(), stderr);
        return cale::kUsage;
    }
    const auto fail = [&](std::string_view what, int code) {
        std::fputs(fmt::format("{}: {}\n", cale::name_with_command(app), what).c_str(), stderr);
        return code;
    };
    try {
        run(app, words);
        cale::flush_standard_output();
    } catch (const cale::ConfigError& error) {
        return fail(error.what(), cale::kUsage);
    } catch (const std::invalid_argument& error) {
        return fail(cale::failure_sentence(error), cale::kUsage);
    } catch (const std::exception& error) {
        return fail(cale::failure_sentence(error), cale::kFailed);
    }
    return exit_code;
}
