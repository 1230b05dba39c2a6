#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "cale/text.h"
#include "report/report.h"
#include "report/tables.h"
#include "settings/versions.h"
#include "tools/commands.h"
#include "tools/usage.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

/// Where scripts/install put it beside the program, else in the source tree that the program was built from.
fs::path baselines_file() {
    const fs::path installed = fs::read_symlink("/proc/self/exe").parent_path().parent_path() /
                               "share/cale/data/reference_scores.csv";
    return fs::exists(installed) ? installed : fs::path(CALE_DATA_DIR) / "reference_scores.csv";
}

/// As it can be typed again.
std::string command_line() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    std::string line;
    for (std::size_t start = 0, end = 0; (end = text.find('\0', start)) != text.npos; start = end + 1) {
        const auto word = text.substr(start, end - start);
        const bool plain = !word.empty() && word.find_first_of(" \t\n'\"\\$*?[]{}()<>|&;!#~`") == word.npos;
        if (!line.empty()) line += ' ';
        if (plain) {
            line += word;
            continue;
        }
        line += '\'';
        for (const char c : word) line += c == '\'' ? std::string("'\\''") : std::string(1, c);
        line += '\'';
    }
    return line;
}

struct Options {
    std::vector<std::string> runs{};
    std::string output{};
    std::vector<std::string> baselines{};
    std::string baselines_csv{};
    std::string score = "training";
    bool strict = false;
    bool web = false;
    ComparisonConfig config{};
};

/// reports/encoders for runs/encoders and runs/encoders/.
fs::path output_folder(const Options& options) {
    if (!options.output.empty()) return options.output;
    fs::path first = fs::absolute(options.runs.front()).lexically_normal();
    if (!first.has_filename()) first = first.parent_path();  // a slash at the end
    return fs::path("reports") / first.filename();
}

void report(Options options) {
    options.config.score = options.score == "training" ? ScoreKind::training : ScoreKind::evaluation;
    const auto csv = options.baselines_csv.empty() ? baselines_file() : fs::path(options.baselines_csv);
    const auto baselines =
        options.baselines.empty() ? std::vector<Baseline>() : read_baselines(csv, options.baselines);
    const std::vector<fs::path> paths(options.runs.begin(), options.runs.end());
    const Comparison comparison = compare(find_runs(paths, options.config.score), baselines, options.config);
    const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
    const PageOrigin origin{.command = command_line(),
                            .version = fmt::format("cale {}", cale_version()),
                            .time = fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(now))};
    const auto folder = output_folder(options);
    make_output_folder("--output", folder);
    const auto files = write_report(comparison, origin, folder, options.web);

    if (!comparison.games.empty()) fmt::print("{}\n", to_text(aggregate_table(comparison)));
    for (const auto& note : comparison.notes) {
        fmt::print("note: {}\n", printable(note.text));
        for (const auto& item : note.items) fmt::print("  {}\n", printable(item));
    }
    fmt::print("{}, and beside it {} figures and tables (.svg, .png, .csv, .tex)\n", files.front().string(),
               files.size() - 1);
    if (options.strict && !comparison.is_complete())
        throw std::runtime_error(
            "--strict: the grid of the runs is not complete: the notes above name the runs that are missing, "
            "unusable or unfinished");
}

}  // namespace

void add_report(CLI::App& app) {
    auto& command =
        *app.add_subcommand("report",
                            "Compares runs: human-normalised aggregates with bootstrap intervals, "
                            "profiles, learning curves, tables, as figures, CSV and one HTML page.");
    const auto options = std::make_shared<Options>();
    auto& config = options->config;
    command
        .add_option("RUNS", options->runs, "folders of runs, or folders that hold runs, such as a sweep's")
        ->required()
        ->type_name("FOLDER");
    command
        .add_option("-o,--output", options->output,
                    "the folder to write to; else reports/<name of the first of RUNS>")
        ->type_name("FOLDER");
    auto* baselines =
        command
            .add_option(
                "--baselines", options->baselines,
                "published scores to draw beside: names of columns of the baselines file, with commas")
            ->type_name("NAMES")
            ->delimiter(',')
            ->allow_extra_args(false);
    command
        .add_option("--baselines-file", options->baselines_csv,
                    "a table of scores by game, instead of the reference_scores.csv that comes with cale")
        ->needs(baselines)
        ->type_name("FILE");
    command
        .add_option(
            "--score", options->score,
            "training: the games of the newest iteration, as the paper has it: a tenth of the run, 250,000 "
            "agent steps at most; evaluation: the newest evaluation")
        ->transform(one_of({"training", "evaluation"}))
        ->type_name("NAME");
    command.add_option("--resamples", config.bootstrap.resamples, "resamples of the bootstrap")
        ->transform(whole_numbers(1, 10'000'000))
        ->type_name("N");
    command
        .add_option(
            "--group-by", config.group_by,
            "the settings that make groups, with commas, 'agent' among them; if not given: whatever differs")
        ->type_name("KEYS")
        ->delimiter(',')
        ->allow_extra_args(false);
    command.add_flag(
        "--strict", options->strict,
        "exit code 1 where the grid of the sweep is not complete: where a run is missing, cannot be "
        "used or is unfinished; the report is written all the same");
    command.add_flag("--web", options->web,
                     "a page that answers: values under the pointer, groups switched off, games filtered; "
                     "still one file, and complete without scripts");
    command.footer(
        "Examples:\n"
        "  cale report runs/encoders --web\n"
        "  cale report runs/sac runs/der --baselines der_100k_vanhasselt2019,spr_100k_rliable\n"
        "  cale report sweeps/encoders --score evaluation --group-by agent.encoder\n"
        "\n"
        "Exit codes: 0 done, 1 failed, or incomplete with --strict, 2 usage.");
    command.callback([options] { report(*options); });
}

}  // namespace cale
