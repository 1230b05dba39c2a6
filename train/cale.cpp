// cale: what is done with runs beside training them.
#include <cstdio>
#include <exception>
#include <string>

#include "experiment/versions.h"
#include "train/commands.h"

int main(int argc, char** argv) {
    CLI::App app("What is done with runs beside training them.", "cale");
    app.set_version_flag("--version", std::string(cale::cale_version()));
    app.require_subcommand(1);
    int exit_code = 0;
    cale::add_bench(app);

    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "cale: %s\n", error.what());
        return 1;
    }
    return exit_code;
}
