#include "sweep/sweep.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <sstream>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fnmatch.h>
#include <unistd.h>

#include "cale/fields.h"
#include "cale/text.h"
#include "report/runs.h"
#include "settings/config.h"
#include "settings/shell_text.h"
#include "storage/files.h"
#include "sweep/config_mismatch.h"
#include "sweep/local_runner.h"
#include "sweep/plan.h"
#include "sweep/run_folder.h"
#include "sweep/search.h"
#include "sweep/settings.h"
#include "sweep/slurm.h"
#include "sweep/sweep_file.h"
#include "sweep/table.h"
#include "terminal/columns.h"
#include "terminal/exit_code.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

bool matches(const std::string& name, const std::string& pattern) {
    return ::fnmatch(pattern.c_str(), name.c_str(), 0) == 0;
}

/// Keeps the runs whose names match one of the patterns; all, where there is none.
void keep_only(std::vector<SweepRun>& runs, const std::vector<std::string>& patterns) {
    for (const auto& pattern : patterns) {
        if (std::ranges::none_of(runs, [&](const SweepRun& run) { return matches(run.name, pattern); }))
            throw ConfigError(fmt::format("--only {}: no run has such a name; one is called {}", pattern,
                                          runs.front().name));
    }
    std::erase_if(runs, [&](const SweepRun& run) {
        return !patterns.empty() && std::ranges::none_of(patterns, [&](const auto& pattern) {
            return matches(run.name, pattern);
        });
    });
}

std::size_t width_of(std::FILE* out) {
    constexpr std::size_t unlimited = 1000;
    const auto size = terminal_size(out);
    return size ? size->columns : unlimited;
}

// ---- the sweep's folder -------------------------------------------------------------

[[noreturn]] void refuse_folder(const fs::path& folder, const std::string& why) {
    throw ConfigError(fmt::format("{}: {}; name another folder by --dir", folder.string(), why));
}

/// Throws ConfigError where something is there that cannot hold runs.
void check_folder(const fs::path& folder) {
    std::error_code error;
    const auto there = fs::status(folder, error);
    if (const auto run = run_above(folder); !run.empty())
        refuse_folder(folder, fmt::format("it is in the folder of a run, {}", run.string()));
    if (there.type() == fs::file_type::not_found) return;
    if (there.type() == fs::file_type::none) refuse_folder(folder, error.message());
    if (!fs::is_directory(there)) refuse_folder(folder, "it is a file, not a folder");
    if (::access(folder.c_str(), R_OK | X_OK) != 0)
        refuse_folder(folder,
                      "it cannot be read: " + std::error_code(errno, std::generic_category()).message());
    if (has_run_record(folder)) refuse_folder(folder, "it is the folder of one run, not of a sweep's");
}

std::vector<std::string> names_of(std::span<const SweepRun> runs) {
    std::vector<std::string> names;
    for (const auto& run : runs) names.push_back(run.name);
    return names;
}

/// Those of a sweep file by itself; none where it lacks what --set says.
std::vector<std::string> names_in(const fs::path& file) {
    try {
        return names_of(read_sweep(file).runs);
    } catch (const ConfigError&) {
        return {};
    }
}

/// Whether the sweep file may have more runs than this call, as the tasks of a job array have.
bool asks_for_a_part(const SweepOptions& options) {
    return !options.overrides.empty() || !options.only.empty();
}

void make_folder(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (!error && ::access(folder.c_str(), W_OK) != 0) error.assign(errno, std::generic_category());
    if (error) refuse_folder(folder, "nothing can be written there: " + error.message());
}

/// The names of all runs that the sweep file asks for, a line each: what `cale report` needs to name those
/// that are missing (kSweepList). `extends`: those that were listed before stay.
void write_run_list(const fs::path& folder, std::vector<std::string> all_runs, bool extends) {
    const auto list = folder / kSweepList;
    const auto before = fs::exists(list) ? read_file(list) : std::string();
    if (extends) {
        std::istringstream lines(before);
        for (std::string line; std::getline(lines, line);)
            if (!line.empty() && std::ranges::find(all_runs, line) == all_runs.end())
                all_runs.push_back(line);
    }
    // A task of a job array that adds nothing does not write, so that it cannot undo what another has just
    // added.
    const auto names = [](std::string_view text) {
        auto of = split(text, '\n');
        std::ranges::sort(of);
        return of;
    };
    const auto now = fmt::format("{}\n", fmt::join(all_runs, "\n"));
    if (names(now) != names(before)) write_file_atomically(list, now);
}

// ---- tasks --------------------------------------------------------------------------

/// Returns the exit code, as do the tasks below.
int show_status(const std::vector<PlannedRun>& runs, const fs::path& folder, std::FILE* out) {
    const auto queued = queued_runs(folder);
    int exit_code = kDone;
    std::vector<RunRow> rows;
    for (const auto& planned : runs) {
        RunRow row{.name = planned.run.name,
                   .state = {},
                   .status = status_of(planned, folder / planned.run.name),
                   .end = planned.end};
        row.state = name_of(row.status.state);
        const auto in_queue = queued.find(row.name);
        const bool refused = row.status.state == RunPhase::refused;
        if (in_queue != queued.end() && !refused && row.status.state != RunPhase::finished) {
            row.state = in_queue->second;
            if (row.state == "running") row.status.state = RunPhase::running;
        } else if (refused || row.status.state == RunPhase::failed) {
            exit_code = kFailed;
        }
        rows.push_back(row);
    }
    fmt::print(out, "{}\n{}\n", table(rows, width_of(out)), summary(rows));
    return exit_code;
}

int show_commands(const std::vector<PlannedRun>& runs, const fs::path& folder, const SweepOptions& options,
                  const std::string& device, std::FILE* out) {
    int exit_code = kDone;
    for (const auto& planned : runs) {
        const auto place = RunPlace{
            .folder = folder / planned.run.name, .threads = options.sharing.threads, .device = device};
        if (const auto refused = refused_lines({&planned, 1}, folder); !refused.empty()) {
            fmt::print(out, "{}", refused);
            exit_code = kFailed;
        } else if (is_finished(place.folder, planned.end)) {
            fmt::print(out, "# finished: {}\n", planned.run.name);
        } else {
            const bool resume = newest_checkpoint_step(place.folder).has_value();
            fmt::print(out, "{}\n", shell_text(command_of(planned, place, resume)));
        }
    }
    return exit_code;
}

SlurmOptions slurm_options(const SweepOptions& options, const Sweep& sweep, std::span<const PlannedRun> runs,
                           const fs::path& folder) {
    const auto& sharing = options.sharing;
    SlurmOptions slurm{
        .name = sweep.name,
        .at_once = sharing.jobs,
        .threads = sharing.threads,
        .memory = sharing.memory_per_run > 0 ? sharing.memory_per_run : largest_memory(runs),
        .options = options.sbatch_options,
        .command = {options.cale.string(), "sweep", fs::absolute(options.file).string(), "--dir",
                    folder.string(), "--jobs", "1", "--threads", std::to_string(sharing.threads), "--retries",
                    std::to_string(options.retries)}};
    if (!sharing.devices.empty())
        slurm.command.insert(slurm.command.end(),
                             {"--device", fmt::format("{}", fmt::join(sharing.devices, ","))});
    if (options.search == SearchMethod::random)
        slurm.command.insert(slurm.command.end(), {"--search", "random"});
    for (const auto& text : options.overrides) slurm.command.insert(slurm.command.end(), {"--set", text});
    return slurm;
}

int submit_to_slurm(const std::vector<PlannedRun>& runs, const fs::path& folder, const SlurmOptions& slurm,
                    const SweepOptions& options, const std::vector<std::string>& all_runs, std::FILE* out) {
    const auto refused = refused_lines(runs, folder);
    const int exit_code = refused.empty() ? kDone : kFailed;
    if (options.task == SweepTask::show_commands) {
        for (const auto& names : job_arrays(runs, folder))
            fmt::print(out, "{}", slurm_script(folder, names, slurm));
        fmt::print(out, "{}", refused);
        return exit_code;
    }
    require_sbatch();
    make_folder(folder);
    write_run_list(folder, all_runs, asks_for_a_part(options));
    const auto lines = submit(runs, folder, slurm);
    for (const auto& line : lines) fmt::print(out, "{}\n", line);
    fmt::print(out, "{}", refused);
    if (lines.empty())
        fmt::print(out, "nothing to submit: all runs are finished, running{} queued\n",
                   refused.empty() ? " or" : ", refused or");
    std::vector<std::string> status{"cale", "sweep", options.file.string(), "--dir",
                                    options.folder.empty() ? folder.string() : options.folder.string()};
    for (const auto& text : options.overrides) status.insert(status.end(), {"--set", text});
    fmt::print(out, "how they stand: {} --status\n", shell_text(status));
    return exit_code;
}

bool makes_no_update(const PlannedRun& planned) {
    return std::ranges::any_of(kWaitsForUpdate, [&](const char* key) {
        const auto* const text = planned_value(planned, key);
        const auto first = text != nullptr ? if_integer(*text) : std::nullopt;
        return first && ends_before_first_update(static_cast<double>(*first),
                                                 static_cast<double>(planned.end.total_steps));
    });
}

// ---- searches -----------------------------------------------------------------------

void check_method(const SweepOptions& options, const Sweep& sweep) {
    const auto file = options.file.string();
    if (sweep.search && options.search == SearchMethod::none && options.task != SweepTask::show_status) {
        throw ConfigError(
            fmt::format("{} has 'search:', so say --search random, which trains every sample to the end, or "
                        "--search halving, which trains the better half twice as far, again and again",
                        file));
    }
    if (!sweep.search && options.search != SearchMethod::none) {
        throw ConfigError(fmt::format(
            "--search: {} has no 'search:' that says which settings to draw; docs/sweeps.md has an example",
            file));
    }
    if (options.search != SearchMethod::halving) return;
    if (options.launcher == Launcher::slurm)
        throw ConfigError(
            "--search halving compares runs while they train, on this machine: leave --launcher slurm out, "
            "or say --search random");
    if (!options.only.empty())
        throw ConfigError("--search halving compares all runs: leave --only out, or say --search random");
}

}  // namespace

int run_sweep(const SweepOptions& options, std::FILE* out) {
    std::signal(SIGCHLD, SIG_DFL);  // of who starts this with it ignored no child could be waited for
    check_devices(options.sharing.devices);
    auto sweep = read_sweep(options.file, options.overrides);
    check_method(options, sweep);
    auto listed = names_of(sweep.runs);
    keep_only(sweep.runs, options.only);
    if (!options.only.empty() && !options.overrides.empty()) {
        // What --set adds to the file is asked for only where --only picks it.
        const auto picked = names_of(sweep.runs), of_file = names_in(options.file);
        std::erase_if(listed, [&](const std::string& name) {
            return std::ranges::find(picked, name) == picked.end() &&
                   std::ranges::find(of_file, name) == of_file.end();
        });
    }
    const auto folder = fs::absolute(options.folder.empty() ? fs::path("runs") / sweep.name : options.folder);
    check_folder(folder);
    const auto runs = plan(sweep, options.cale.parent_path());
    if (options.task == SweepTask::show_status) return show_status(runs, folder, out);
    Search search{.sweep = sweep, .runs = runs, .method = options.search, .folder = folder};
    const bool compares = options.search != SearchMethod::none && options.only.empty();
    if (compares) check_search(search);
    if (options.launcher == Launcher::slurm)
        return submit_to_slurm(runs, folder, slurm_options(options, sweep, runs, folder), options, listed,
                               out);

    auto machine = Machine::here();
    machine.gpus = options.gpus;
    const auto slots = share(machine, options.sharing, runs);
    if (options.task == SweepTask::show_commands) {
        if (compares && refuse_others(search, out)) return kFailed;
        const auto next = compares ? next_runs(search) : runs;
        if (next.empty()) fmt::print(out, "# finished: the search, {} runs\n", runs.size());
        return show_commands(next, folder, options, slots.slots.front().device, out);
    }
    make_folder(folder);
    write_run_list(folder, listed, asks_for_a_part(options));
    fmt::print(stderr, "{}: {} in {}, {} at once ({})\n", sweep.name, counted(runs.size(), "run"),
               folder.string(), slots.slots.size(), slots.reason);
    if (sweep.repeated > 0)
        fmt::print(stderr, "note: {} of {} combinations repeat another one, which is trained once\n",
                   sweep.repeated, sweep.repeated + sweep.runs.size());
    if (const auto count = std::ranges::count_if(runs, makes_no_update); count > 0)
        fmt::print(
            stderr,
            "note: {} without an update: the end comes before agent.min_replay or agent.rollout_steps\n",
            counted(static_cast<std::size_t>(count), "run"));
    search.train = [&](std::span<const PlannedRun> some) {
        return run_locally(some, folder, slots,
                           {.threads = options.sharing.threads,
                            .retries = options.retries,
                            .live_table = options.live_table});
    };
    return compares ? run_search(search, out) : search.train(runs);
}

}  // namespace cale
