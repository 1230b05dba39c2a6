#include <filesystem>
#include <memory>
#include <string>

#include <fmt/format.h>

#include "cale/text.h"
#include "tools/commands.h"
#include "tools/usage.h"
#include "train/export.h"

namespace cale {

void add_export(CLI::App& app) {
    struct Options {
        std::string from, output, format;
    };
    auto& command =
        *app.add_subcommand("export", "Makes a policy file, for other programs, of what a run learned.");
    const auto options = std::make_shared<Options>();
    command.add_option("PATH", options->from, "a checkpoint, or a run: its newest checkpoint")
        ->required()
        ->type_name("FILE");
    command.add_option("-o,--output", options->output, "the file to write")->required()->type_name("FILE");
    command
        .add_option("--format", options->format,
                    "policy: docs/policy_file.md; onnx: for ONNX runtimes; else onnx if the file's name ends "
                    "in .onnx, and policy if not")
        ->transform(one_of({"policy", "onnx"}))
        ->type_name("NAME");
    command.footer(
        "Examples:\n"
        "  cale export runs/Breakout__sac__1__1795270400 -o breakout.safetensors\n"
        "  cale export runs/Breakout__sac__1__1795270400/checkpoints/step_000100000 -o breakout.onnx\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] {
        check_output_file("--output", options->output);
        const std::filesystem::path output = options->output;
        const bool onnx = options->format.empty() ? output.extension() == ".onnx" : options->format == "onnx";
        const auto write = onnx ? export_onnx : export_policy;
        const auto info = write(options->from, output);
        const auto origin = [&](const char* name) {
            const auto found = info.provenance.find(name);
            return found == info.provenance.end() ? std::string("unknown") : printable(found->second);
        };
        fmt::print("{}: {} on {}, {}{} agent steps, seed {}; {:.1f} MB\n", options->output,
                   printable(info.agent), printable(info.game),
                   info.encoder.empty() ? "" : printable(info.encoder) + ", ", origin("agent_steps"),
                   origin("seed"), static_cast<double>(std::filesystem::file_size(output)) / 1e6);
    });
}

}  // namespace cale
