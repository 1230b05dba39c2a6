#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/text.h"
#include "report/csv.h"
#include "report/recorded_runs.h"
#include "report/report.h"
#include "report/tables.h"
#include "settings/shell_text.h"
#include "settings/versions.h"
#include "storage/files.h"
#include "tools/commands.h"
#include "tools/usage.h"
#include "train/resume.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

// That the terminal shows.
constexpr std::size_t kMostPairs = 10;  // of groups
constexpr std::size_t kMostItems = 10;  // of a note

/// A table that comes with cale.
fs::path data_file(const fs::path& name) {
    return shared_path("data" / name, CALE_DATA_DIR / name);
}

/// As it can be typed again.
std::string command_line() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    std::vector<std::string> words;
    for (std::size_t start = 0, end = 0; (end = text.find('\0', start)) != text.npos; start = end + 1)
        words.push_back(text.substr(start, end - start));
    return shell_text(words);
}

struct Options {
    std::vector<std::string> runs{};
    std::string output{};
    std::vector<std::string> baselines{};
    std::string baselines_csv{};
    std::string score = "training";
    bool strict = false;
    bool web = false;
    std::vector<std::string> names{};
    ComparisonConfig config{};
};

/// What is drawn beside the runs.
struct Beside {
    std::vector<Baseline> baselines{};
    std::vector<Run> recorded{};
};

bool contains(const std::vector<std::string>& names, const std::string& name) {
    return std::ranges::find(names, name) != names.end();
}

/// The names that a text lists with commas, which may be in a name, too.
std::vector<std::string> listed_names(const std::vector<std::string>& texts,
                                      const std::vector<std::string>& groups) {
    std::vector<std::string> names;
    for (const auto& text : texts) {
        if (contains(groups, text)) {
            names.push_back(text);
        } else {
            for (auto& name : split(text, ',')) names.push_back(CLI::detail::trim(name));
        }
    }
    return names;
}

/// The names that hold the text; without one the nearest, if any is near.
std::vector<std::string> resembling(const std::string& text, const std::vector<std::string>& names) {
    std::vector<std::string> found;
    std::ranges::copy_if(names, std::back_inserter(found),
                         [&](const std::string& name) { return name.find(text) != name.npos; });
    if (const auto guess = nearest(text, names); found.empty() && !guess.empty()) found.push_back(guess);
    return found;
}

/// For lists: 'agent, agent.encoder' is 'agent,agent.encoder'.
std::string trim(std::string& text) {
    CLI::detail::trim(text);
    return {};
}

/// 'cale' stands for all our own results; another name is one of their groups, or a column of published
/// scores.
Beside read_beside(const Options& options) {
    Beside beside;
    if (options.baselines.empty()) return beside;
    const bool shipped = options.baselines_csv.empty();
    const auto own = shipped ? data_file("cale_scores.csv") : fs::path(options.baselines_csv);
    const auto table = read_csv_by_hand(own);
    const bool has_groups = table.find("group").has_value();
    const auto groups = has_groups ? recorded_groups(table) : std::vector<std::string>();
    std::vector<std::string> recorded, published;
    for (const auto& name : listed_names(options.baselines, groups)) {
        if (contains(groups, name)) {
            recorded.push_back(name);
        } else if (shipped && name == "cale") {
            recorded = groups;
        } else if (has_groups && !shipped) {
            throw std::invalid_argument(fmt::format("--baselines {}: {} has no such group; there are {}",
                                                    name, own.string(), fmt::join(groups, "; ")));
        } else if (!contains(published, name)) {
            published.push_back(name);
        }
    }
    if (!recorded.empty() && options.score != "training")
        throw std::invalid_argument(
            "--baselines: recorded runs have scores of their training: leave --score evaluation out, or "
            "them");
    if (!recorded.empty()) beside.recorded = read_recorded_runs(table, recorded);
    if (published.empty()) return beside;
    const auto scores = shipped ? read_csv_by_hand(data_file("reference_scores.csv")) : table;
    for (const auto& name : published) {
        try {
            beside.baselines.push_back(read_baselines(scores, {name}).front());
        } catch (const std::invalid_argument& error) {
            if (!shipped) throw;
            const auto guesses = resembling(name, groups);
            throw std::invalid_argument(
                error.what() + (guesses.empty()
                                    ? std::string("; --baselines cale has all of cale's own")
                                    : fmt::format("; cale's own has '{}'", fmt::join(guesses, "', '"))));
        }
    }
    return beside;
}

/// "sac=SAC", the label of a group and the name that it is to have.
std::map<std::string, std::string> names_of_groups(const std::vector<std::string>& texts) {
    std::map<std::string, std::string> names;
    for (const auto& text : texts) {
        // A label may hold '=' itself: "threshold=0.5".
        const auto equals = text.rfind('=');
        if (equals == text.npos || equals == 0 || equals + 1 == text.size())
            throw std::invalid_argument(
                fmt::format("--name {}: expected LABEL=NAME, such as 'sac, phi_dqn=SAC'", text));
        if (printable(text) != text)
            throw std::invalid_argument(
                fmt::format("--name {}: it holds a control character, or is not UTF-8", text));
        if (!names.emplace(text.substr(0, equals), text.substr(equals + 1)).second)
            throw std::invalid_argument(
                fmt::format("--name {}: this group has been given another name already", text));
    }
    return names;
}

/// reports/encoders for runs/encoders and runs/encoders/.
fs::path output_folder(const Options& options) {
    if (!options.output.empty()) return options.output;
    if (options.runs.empty()) return "reports/cale";
    return fs::path("reports") / without_slash(fs::absolute(options.runs.front())).filename();
}

/// A report has files of its own, and replaces those of an earlier one, run_curves.csv among them.
void require_another_folder(const Options& options, const fs::path& folder) {
    const auto above = run_above(folder);
    if (has_run_record(folder) || !above.empty())
        throw std::invalid_argument(
            fmt::format("{}: it is {}; name another folder by --output", folder.string(),
                        above.empty() ? "the folder of a run" : "in the folder of a run, " + above.string()));
    if (options.baselines_csv.empty()) return;
    std::error_code none;  // a pipe has no path
    const auto table = fs::weakly_canonical(options.baselines_csv, none);
    if (table.parent_path() != fs::weakly_canonical(folder)) return;
    throw std::invalid_argument(
        fmt::format("--baselines-file {}: it is in {}, where the report would replace it; name another "
                    "folder by --output",
                    options.baselines_csv, folder.string()));
}

void report(Options options) {
    options.config.score = options.score == "training" ? ScoreKind::training : ScoreKind::evaluation;
    options.config.names = names_of_groups(options.names);
    auto [baselines, recorded] = read_beside(options);
    if (options.runs.empty() && recorded.empty())
        throw std::invalid_argument("name folders of runs, or recorded ones: --baselines cale");
    const std::vector<fs::path> paths(options.runs.begin(), options.runs.end());
    auto found = find_runs(paths, options.config.score);
    if (!paths.empty()) require_runs(found);
    std::ranges::move(recorded, std::back_inserter(found.runs));
    const auto folder = output_folder(options);
    require_another_folder(options, folder);
    const auto made = make_output_folder("--output", folder);
    const Comparison comparison = compare(std::move(found), baselines, options.config);
    const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
    const PageOrigin origin{.command = command_line(),
                            .version = fmt::format("cale {}", cale_version()),
                            .time = fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(now))};
    const auto files = write_report(comparison, origin, folder, options.web);

    if (!comparison.games.empty()) fmt::print("{}\n", to_text(aggregate_table(comparison)));
    if (const auto pairs = improvement_table(comparison);
        !pairs.rows.empty() && pairs.rows.size() <= kMostPairs)
        fmt::print("{}\n", to_text(pairs));
    else if (pairs.rows.size() > kMostPairs)
        fmt::print("P(X > Y) of {} pairs of groups: probability_of_improvement.csv\n\n", pairs.rows.size());
    for (const auto& note : comparison.notes) {
        fmt::print("note: {}\n", printable(note.text));
        const auto shown = std::min(note.items.size(), kMostItems);
        for (std::size_t i = 0; i < shown; ++i) fmt::print("  {}\n", printable(note.items[i]));
        if (shown < note.items.size())
            fmt::print("  and {} more: report.html has all\n", note.items.size() - shown);
    }
    fmt::print("{}, and beside it {} figures and tables (.svg, .png, .csv, .tex, .md)\n",
               printable(files.front().string()), files.size() - 1);
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
        ->type_name("DIR");
    command
        .add_option("-o,--output", options->output,
                    "the folder to write to; else reports/<name of the first of RUNS>")
        ->type_name("DIR");
    auto* baselines = command
                          .add_option("--baselines", options->baselines,
                                      "what to draw beside, with commas: published scores, by their columns "
                                      "of the baselines file; cale: the runs of cale's own results, or "
                                      "groups of them by name")
                          ->type_name("NAMES")
                          ->allow_extra_args(false);
    command
        .add_option(
            "--baselines-file", options->baselines_csv,
            "a table of scores by game, or of runs (run_curves.csv of a report), instead of those that come "
            "with cale")
        ->needs(baselines)
        ->type_name("FILE");
    command
        .add_option(
            "--score", options->score,
            "training: the games of the newest iteration, as the paper has it: a tenth of the run, 250,000 "
            "agent steps at most; evaluation: that of the newest checkpoint; of several, "
            "the one with the most games")
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
        ->transform(CLI::Validator(trim, ""))
        ->allow_extra_args(false);
    command
        .add_option("--name", options->names,
                    "gives a group, or one of the published scores, another name, without '=': --name 'sac, "
                    "phi_dqn=SAC'")
        ->type_name("LABEL=NAME")
        ->allow_extra_args(false)
        ->take_all();
    command.add_flag(
        "--strict", options->strict,
        "exit code 1 where the grid of the sweep is not complete: where a run is missing, cannot be "
        "used or is unfinished; the report is written all the same");
    command.add_flag("--web", options->web,
                     "an interactive page: values under the pointer, groups switched off, games filtered; "
                     "still one file, and complete without scripts");
    command.footer(
        "Examples:\n"
        "  cale report runs/encoders --web\n"
        "  cale report runs/sac runs/der --baselines der_100k_vanhasselt2019,spr_100k_rliable\n"
        "  cale report runs/sac --baselines cale\n"
        "  cale report runs/encoders --score evaluation --group-by agent.encoder\n"
        "\n"
        "Exit codes: 0 done, 1 failed, or incomplete with --strict, 2 usage.");
    command.callback([options] { report(*options); });
}

}  // namespace cale
