#include <array>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/text.h"
#include "settings/config.h"
#include "settings/shell_text.h"
#include "storage/manifest.h"
#include "tools/commands.h"
#include "tools/usage.h"
#include "train/export.h"

namespace cale {

namespace {

namespace fs = std::filesystem;

struct Options {
    std::string from, output, format, web;
};

std::string description(const PolicyInfo& info) {
    const auto origin = [&](const char* name) {
        const auto found = info.provenance.find(name);
        return found == info.provenance.end() ? std::string("unknown") : printable(found->second);
    };
    return fmt::format("{} on {}, {}{} agent steps, seed {}", printable(info.agent), printable(info.game),
                       info.encoder.empty() ? "" : printable(info.encoder) + ", ", origin("agent_steps"),
                       origin("seed"));
}

/// Whether it begins as a policy file does, or as an ONNX file with our name as its producer's.
bool is_exported(const fs::path& file) {
    std::string head(65'536, '\0');
    std::ifstream(file, std::ios::binary).read(head.data(), std::ssize(head));
    constexpr std::string_view kProducer(
        "\x12\x04"
        "cale");
    return head.find("\"cale_policy\"") != head.npos || head.find(kProducer) != head.npos;
}

/// A link is followed, as it is when the file is written.
void require_outside_checkpoint(std::string_view option, const fs::path& file) {
    std::error_code ignored;
    if (holds_manifest(fs::absolute(file).parent_path()) ||
        holds_manifest(fs::weakly_canonical(file, ignored).parent_path()))
        throw ConfigError(fmt::format("{} {} lies in a checkpoint, which would then be damaged; give another",
                                      option, file.string()));
}

void export_file(const Options& options) {
    check_output_file("--output", options.output);
    const fs::path output = options.output;
    std::error_code ignored;
    if (fs::equivalent(options.from, output, ignored))
        throw ConfigError(fmt::format("--output {} is the file that is read; give another", options.output));
    require_outside_checkpoint("--output", output);
    if (fs::is_regular_file(output, ignored) && fs::file_size(output) > 0 && !is_exported(output))
        throw ConfigError(fmt::format("--output {} is there, and no cale export has written it; give another",
                                      options.output));
    const bool onnx =
        options.format.empty() ? lower(output.extension().string()) == ".onnx" : options.format == "onnx";
    const auto write = onnx ? export_onnx : export_policy;
    const auto info = write(options.from, output);
    fmt::print("{}: {}; {:.1f} MB\n", printable(options.output), description(info),
               static_cast<double>(fs::file_size(output)) / 1e6);
}

void export_page(const Options& options) {
    const auto page = shared_path("web", CALE_WEB_DIR);
    const auto made = make_output_folder("--web", options.web);
    if (!fs::is_empty(made.path()) && !fs::exists(made.path() / "cale_module.wasm")) {
        throw ConfigError(
            fmt::format("--web {}: there are files in it that are none of a page of cale's, and one of the "
                        "same name would be written over; give a new folder",
                        options.web));
    }
    for (const auto& file : fs::directory_iterator(made.path())) require_outside_checkpoint("--web", file);
    const auto info = export_web_page(options.from, page, options.web);
    fmt::print(
        "{}: {}\nTo see it: {}, then http://localhost:8000 and a ROM of {}\n", options.web, description(info),
        shell_text(std::array<std::string, 5>{"python3", "-m", "http.server", "--directory", options.web}),
        fmt::join(split(printable(info.game), '+'), " or "));
}

}  // namespace

void add_export(CLI::App& app) {
    auto& command = *app.add_subcommand(
        "export", "Makes a policy file, for other programs, or a web page of what a run learned.");
    const auto options = std::make_shared<Options>();
    command.add_option("PATH", options->from, "a checkpoint, a run: its newest checkpoint, or a policy file")
        ->required()
        ->type_name("FILE");
    auto* file = command.add_option("-o,--output", options->output, "the file to write")->type_name("FILE");
    command
        .add_option("--format", options->format,
                    "policy: docs/policy_file.md; onnx: for ONNX runtimes; else onnx if the file's name ends "
                    "in .onnx, and policy if not")
        ->needs(file)
        ->transform(one_of({"policy", "onnx"}))
        ->type_name("NAME");
    auto* web = command
                    .add_option("--web", options->web,
                                "instead of a file, the folder for a page in which the policy plays: "
                                "docs/web.md; scripts/web must have built the page")
                    ->excludes(file)
                    ->type_name("DIR");
    command.footer(
        "Examples:\n"
        "  cale export runs/Breakout__sac__1__1795270400 -o breakout.safetensors\n"
        "  cale export runs/Breakout__sac__1__1795270400/checkpoints/step_000100000 -o breakout.onnx\n"
        "  cale export policies/road_runner_sac.safetensors --web site\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options, file, web] {
        if (file->count() == 0 && web->count() == 0)
            throw ConfigError("give --output FILE, the file to write, or --web DIR, the folder for a page");
        if (web->count() > 0) {
            export_page(*options);
        } else {
            export_file(*options);
        }
    });
}

}  // namespace cale
