// cale: what is done with runs beside training them.
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>

#include <c10/util/Exception.h>

#include "experiment/config.h"
#include "experiment/versions.h"
#include "train/commands.h"
#include "train/help.h"

int main(int argc, char** argv) {
    CLI::App app("What is done with runs beside training them.", "cale");
    app.set_version_flag("--version", std::string(cale::cale_version()));
    app.require_subcommand(1);
    app.formatter(cale::help_formatter());
    app.option_defaults()->always_capture_default();
    app.footer(
        "`cale COMMAND --help` says more, with examples.\n"
        "Agents are trained by train_sac, train_sacd, train_ppo, train_dqn and train_der.\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    int exit_code = 0;
    cale::add_bench(app);
    cale::add_completion(app);
    cale::add_evaluate(app);
    cale::add_export(app);
    cale::add_games(app);
    cale::add_map(app);
    cale::add_play(app);
    cale::add_report(app);
    cale::add_sweep(app, exit_code);

    const auto fail = [](const char* what, int code) {
        std::fprintf(stderr, "cale: %s\n", what);
        return code;
    };
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const cale::ConfigError& error) {
        return fail(error.what(), 2);
    } catch (const std::invalid_argument& error) {
        return fail(error.what(), 2);
    } catch (const c10::Error& error) {
        // LibTorch's what() carries a stack trace.
        return fail(error.what_without_backtrace(), 1);
    } catch (const std::exception& error) {
        return fail(error.what(), 1);
    }
    return exit_code;
}
