#include "train/program.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <limits>
#include <optional>
#include <stdexcept>

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <c10/core/impl/VirtualGuardImpl.h>
#include <fmt/format.h>
#include <torch/types.h>

#include "agents/memory.h"
#include "agents/process.h"
#include "cale/cores.h"
#include "cale/text.h"
#include "evaluate/run_evaluations.h"
#include "policy/policy_info.h"
#include "replay/available_memory.h"
#include "report/runs.h"
#include "settings/command_line.h"
#include "settings/shell_text.h"
#include "storage/append_file.h"
#include "storage/files.h"
#include "storage/metadata_text.h"
#include "storage/new_folder.h"
#include "storage/run_lock.h"
#include "storage/step_name.h"
#include "terminal/console.h"
#include "terminal/exit_code.h"
#include "terminal/failure.h"
#include "terminal/standard_output.h"
#include "terminal/stop_signals.h"
#include "train/checkpoint.h"
#include "train/metadata.h"
#include "train/resume.h"
#include "train/threads.h"
#include "train/training.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// How long the other processes wait for the first one, which evaluates alone: a hundred of the longest games
/// take two hours on a slow core. A process that ends is noticed at once.
constexpr auto kLongestEvaluation = std::chrono::hours(6);

/// Returns what `make` returns. What it throws as std::invalid_argument becomes a ConfigError.
template <class Make>
auto invalid_argument_as_config_error(const Make& make) {
    try {
        return make();
    } catch (const std::invalid_argument& error) {
        throw ConfigError(error.what());
    }
}

/// The other processes that this one was started with, once they are all there.
ProcessGroup join_processes(const std::optional<ProcessRank>& process, const TrainingProgram& program,
                            torch::Device device) {
    if (!process) return {};
    if (process->rank == 0)
        std::fprintf(stderr, "%s: waiting for the other %d of %d processes at %s:%d\n", program.name.c_str(),
                     process->size - 1, process->size, process->master_address.c_str(), process->master_port);
    return invalid_argument_as_config_error([&] {
        ProcessGroup processes(*process, device, kLongestEvaluation);
        processes.require_same(program.table.to_yaml(),
                               fmt::format("process {} of {}: the processes of this run were started with "
                                           "different settings; give all of them the same command line",
                                           process->rank, process->size));
        return processes;
    });
}

/// Where WORLD_SIZE and its companions put this process; none: it is alone.
std::optional<ProcessRank> find_rank(const TrainingProgram& program, const TrainingWorld& world) {
    auto process = invalid_argument_as_config_error(rank_from_environment);
    if (!process) return process;
    if (!program.several_processes) {
        throw ConfigError(
            fmt::format("WORLD_SIZE={}: {} trains in one process: start {} without torchrun and with "
                        "WORLD_SIZE unset",
                        process->size, program.agent_name, program.name));
    }
    if (program.num_envs % process->size != 0) {
        throw ConfigError(fmt::format(
            "env.num_envs is {}, which WORLD_SIZE={} processes cannot share equally; make it a multiple",
            program.num_envs, process->size));
    }
    const auto games = std::max<std::int64_t>(1, std::ssize(world.games));
    const auto share = program.num_envs / process->size;
    if (share % games != 0) {
        throw ConfigError(fmt::format(
            "env.num_envs is {}, {} for each of WORLD_SIZE={} processes, in which the {} games of env.game "
            "need as many environments each; make it a multiple of {}",
            program.num_envs, share, process->size, games, games * process->size));
    }
    return process;
}

/// Several processes on a machine take a CUDA device each.
torch::Device choose_device(const std::string& requested, const std::optional<ProcessRank>& process) {
    const auto gpus = at::getNumGPUs();
    if (!process) return find_device(requested, gpus);
    return find_device(requested, gpus, static_cast<std::uint64_t>(process->local_rank));
}

/// A resumed run uses the number of threads it was started with: sums on other numbers of threads
/// round differently.
int choose_threads(const CommandLine& line, const TrainingProgram& program, const TrainingWorld& world,
                   const std::optional<Metadata>& resumed, const fs::path& run_dir, int processes_here) {
    if (line.threads != "auto") return std::stoi(line.threads);
    if (resumed && resumed->threads()) return *resumed->threads();
    if (line.resume && !resumed) {
        throw ResumeError(
            fmt::format("--resume {}: there is no metadata.json that says with how many threads the run was "
                        "started; say --threads with that number",
                        run_dir.string()));
    }
    // Without pictures a network's products are too small to be shared: two threads are no faster than one,
    // and far slower where another program takes one of the cores.
    if (program.spec().observation.shape.size() < 2) return 1;
    // OMP_NUM_THREADS is the user's word, but with several processes torchrun's.
    const int most = processes_here > 1 ? std::numeric_limits<int>::max() : at::get_num_threads();
    const int all = std::min(static_cast<int>(core_count()), most);
    const int cores = std::max(1, all / processes_here);
    const auto env_threads = static_cast<int>(world.threads);
    // Environments that step during an update keep their cores. An agent that learns beside many steps leaves
    // them time enough on all (docs/performance.md).
    const bool steps_wait = program.settings.train.overlap || program.settings.train.realtime;
    return measured_threads(steps_wait && !program.learns_beside ? std::max(1, cores - env_threads) : cores);
}

/// Returns the first process's number in all of them: the run's record has one, and sums on another number
/// of threads round differently.
int broadcast_threads(int threads, const ProcessGroup& processes) {
    auto number = torch::tensor(processes.first() ? std::int64_t{threads} : 0, torch::kInt64);
    processes.sum({number});  // the others add 0
    return number.item<int>();
}

/// 1234567 as "1,234,567".
std::string grouped(std::int64_t number) {
    const std::string digits = std::to_string(number);
    std::string text;
    for (std::size_t i = 0; i < digits.size(); ++i) {
        if (i > 0 && (digits.size() - i) % 3 == 0) text += ',';
        text += digits[i];
    }
    return text;
}

fs::path choose_run_dir(const CommandLine& line, const TrainingProgram& program, const TrainingWorld& world) {
    if (!line.run_dir.empty()) return line.run_dir;
    return fs::path("runs") / fmt::format("{}__{}__{}__{}", world.name, program.agent_name,
                                          program.settings.train.seed,
                                          static_cast<std::int64_t>(std::time(nullptr)));
}

/// Refuses a folder with other runs in it, at any depth, or with a sweep's list of them: as a run itself it
/// would hide them.
void require_no_runs_below(const fs::path& run_dir) {
    if (!fs::is_directory(run_dir)) return;
    const auto runs = run_folders(run_dir);
    if (runs.empty() && !fs::exists(run_dir / kSweepList)) return;
    throw ConfigError(fmt::format(
        "--run-dir {}: it holds {}; give the run a folder of its own, such as {}", run_dir.string(),
        runs.empty() ? "a sweep's runs" : fmt::format("other runs, such as {}", runs.front().string()),
        (run_dir / "my_run").string()));
}

/// Refuses a folder that lies in a run's, or holds runs, but for one that was stopped before its first
/// checkpoint, or files of others that a run would replace.
void require_no_run(const fs::path& run_dir) {
    if (const auto above = run_above(run_dir); !above.empty()) {
        throw ConfigError(
            fmt::format("--run-dir {}: it is in the folder of another run, {}; choose another one",
                        run_dir.string(), above.string()));
    }
    if (has_begun(run_dir)) {
        throw ConfigError(fmt::format(
            "--run-dir {}: a run is in there already; choose another folder, or resume it with --resume",
            run_dir.string()));
    }
    // A run writes its metadata first.
    if (!metadata_text(run_dir, "program").empty() || has_run_record(run_dir)) return;
    require_no_runs_below(run_dir);
    for (const auto* name :
         {"config.yaml", "metadata.json", "episodes.csv", "progress.csv", "joystick_events.csv",
          "learning_curve.svg", "learning_curve.png", "checkpoints", "eval", "videos"}) {
        if (!fs::exists(run_dir / name)) continue;
        throw ConfigError(
            fmt::format("--run-dir {}: its {} is no run's, and would be replaced; choose another folder",
                        run_dir.string(), name));
    }
}

ConfigError taken(const fs::path& run_dir) {
    return ConfigError(fmt::format(
        "--run-dir {}: another process is training in there; choose another folder", run_dir.string()));
}

/// Without --run-dir no other process gets the same.
NewFolder make_run_dir(const CommandLine& line, const fs::path& run_dir) {
    try {
        if (line.run_dir.empty()) {
            if (const auto above = run_above(run_dir); !above.empty())
                throw ConfigError(
                    fmt::format("the working folder is that of another run, {}, or in it; work in another "
                                "one, or give --run-dir",
                                above.string()));
            return NewFolder::with_a_free_name(run_dir);
        }
        if (RunLock::is_taken(run_dir)) throw taken(run_dir);
        require_no_run(run_dir);
        return NewFolder(run_dir);
    } catch (const fs::filesystem_error& error) {
        throw ConfigError(fmt::format("--run-dir {}: the folder cannot be made ({}); choose another one",
                                      run_dir.string(), error.code().message()));
    }
}

/// Another process may have taken the folder while networks and environments were made.
void lock_new_run(const fs::path& run_dir, std::optional<RunLock>& lock) {
    try {
        lock.emplace(run_dir);
    } catch (const FolderTaken&) {
        throw taken(run_dir);
    }
}

/// What differs from the settings that the run was trained with. The checkpoint that it is resumed from has
/// them, whatever has been written into the run's config.yaml since; where none is whole, that is all there
/// is.
std::vector<ConfigDifference> changes_since(const TrainingProgram& program, const fs::path& run_dir,
                                            const std::optional<StoredCheckpoint>& checkpoint) {
    try {
        if (checkpoint) return program.table.differences(checkpoint->folder / "config.yaml");
    } catch (const std::system_error&) {
        throw;  // it cannot be read now
    } catch (const std::exception&) {
        // Of another version.
    }
    return program.table.differences(run_dir / "config.yaml");
}

/// Throws ResumeError for a checkpoint beyond the run's end, which is the first step of all environments at
/// or beyond train.total_steps.
void check_length(const TrainingProgram& program, const fs::path& run_dir, const fs::path& checkpoint) {
    const auto step = step_in(checkpoint).value_or(0);
    if (step - program.settings.train.total_steps >= program.num_envs) {
        throw ResumeError(fmt::format(
            "--resume {}: it is at agent step {} already, and train.total_steps is {}; let it be more",
            run_dir.string(), step, program.settings.train.total_steps));
    }
}

/// Refuses a run whose config.yaml lacks keys, as one that was cut short does: it would continue with their
/// defaults. `copy`: that of its newest checkpoint.
void require_whole_config(const fs::path& file, const fs::path& copy) {
    if (const auto lack = lacks(file, copy); !lack.empty())
        throw ResumeError(fmt::format("--resume: {}", lack));
}

/// Returns the metadata of a run that is to be resumed. Throws ResumeError if they are damaged.
std::optional<Metadata> read_metadata(const fs::path& run_dir) {
    try {
        return Metadata::read(run_dir);
    } catch (const std::system_error&) {
        throw;  // it cannot be read now
    } catch (const std::exception& error) {
        throw ResumeError(fmt::format("--resume {}: {}", run_dir.string(), error.what()));
    }
}

/// What --accept-changes lets differ from the checkpoint.
struct AcceptedChanges {
    std::string different{};           // as a list for a sentence
    bool evaluates_otherwise = false;  // an evaluation is to be played by other settings
};

/// Throws ResumeError unless all changes of its settings may be, or were accepted and do not make other games
/// of those under way.
AcceptedChanges accepted_changes(const TrainingProgram& program, const fs::path& run_dir,
                                 const CommandLine& line) {
    const auto all = require_checkpoints(run_dir);
    const auto whole = newest_whole_checkpoint(run_dir);
    const auto newest = whole ? whole->folder : all.back();
    const fs::path file = run_dir / "config.yaml";
    if (!fs::exists(file)) {
        throw ResumeError(fmt::format("--resume: {} is missing; copy {} there", file.string(),
                                      (newest / "config.yaml").string()));
    }
    if (line.config_file == file) require_whole_config(file, newest / "config.yaml");
    AcceptedChanges changes;
    auto& different = changes.different;
    std::string of_the_games, of_the_seed;
    for (const auto& [key, now, before] : changes_since(program, run_dir, whole)) {
        if (key.starts_with("eval.") && key != "eval.every") changes.evaluates_otherwise = true;
        const auto change = change_of_run(key, before, now, program.schedule_over_run());
        if (change.empty()) continue;
        different += (different.empty() ? "" : ", ") + change;
        if (key.starts_with("env.")) of_the_games += (of_the_games.empty() ? "" : ", ") + change;
        if (key == "train.seed") of_the_seed = change;
    }
    // Accepted once is enough, also where the run was killed before a checkpoint had it.
    const auto accepted = [&] {
        const auto metadata = read_metadata(run_dir);
        return metadata && metadata->newest_change() == different;
    };
    if (!different.empty() && !line.accept_changes && !accepted()) {
        throw ResumeError(fmt::format(
            "--resume {}: another configuration: {}; resume with the run's own (leave --config and --set "
            "out, and its config.yaml as it was){} or start a new run",
            run_dir.string(), different,
            of_the_games.empty() && of_the_seed.empty() ? ", say --accept-changes," : ""));
    }
    if (!of_the_seed.empty()) {
        throw ResumeError(
            fmt::format("--resume {} --accept-changes: a run's random numbers continue from its checkpoint, "
                        "whatever its seed: {}; start a new run",
                        run_dir.string(), of_the_seed));
    }
    if (!of_the_games.empty()) {
        throw ResumeError(
            fmt::format("--resume {} --accept-changes: games under way cannot be continued in another "
                        "environment: {}; start a new run",
                        run_dir.string(), of_the_games));
    }
    check_length(program, run_dir, newest);
    return changes;
}

/// Calls train() and records its end in metadata.json. Says how to resume a run that the machine stopped.
Outcome train_on_record(Agent& agent, const TrainingWorld& world, const RunSettings& settings,
                        const TrainOptions& options, Metadata* metadata) {
    if (metadata == nullptr) return train(agent, world, settings, options);
    try {
        const auto outcome = train(agent, world, settings, options);
        if (outcome == Outcome::finished) {
            metadata->finish();
        } else if (outcome == Outcome::paused) {
            metadata->stop(fmt::format("--until {}", options.until));
        } else {
            metadata->stop(
                std::string(stop_signal().empty() ? "another process was stopped" : stop_signal()));
        }
        metadata->write();
        return outcome;
    } catch (const ResumeError&) {
        throw;  // nothing has been trained
    } catch (const std::exception& error) {
        if (!metadata->has_this_session()) throw;  // nor here
        try {
            metadata->stop(failure_sentence(error));
            metadata->write();
        } catch (const std::exception&) {
            // The disk is full: the first failure is the one to report.
        }
        if (!is_of_the_machine(error) || list_checkpoints(options.run_dir).empty()) throw;
        throw std::runtime_error(fmt::format("{}; then resume with {}",
                                             failure_sentence(error, /*may_move=*/false),
                                             resume_options(options.run_dir)));
    }
}

/// Trains as train_on_record() and returns the program's exit code. `changes`: what --accept-changes
/// accepted.
ExitCode train_for_exit_code(Agent& agent, const TrainingWorld& world, const RunSettings& settings,
                             const TrainOptions& options, Metadata* metadata, const std::string& changes) {
    try {
        const Outcome outcome = train_on_record(agent, world, settings, options, metadata);
        return outcome == Outcome::interrupted ? kInterrupted : kDone;
    } catch (const DoesNotFit& error) {
        if (changes.empty()) throw;
        throw ResumeError(fmt::format(
            "--accept-changes: {}, which what is stored may not fit: {}; take that back, or start a new run",
            changes, error.without_way_out));
    }
}

/// Returns what `make` returns. What it throws becomes a ConfigError, except for a lack of memory.
template <class Make>
auto all_but_memory_as_config_error(const Make& make) {
    try {
        return make();
    } catch (const std::exception& error) {
        if (is_out_of_memory(error)) throw;
        throw ConfigError(error.what());
    }
}

/// Makes an environment once, of several games one each, so that what is wrong with it, or with a ROM, is
/// said before anything is written.
std::unique_ptr<World> make_one(const TrainingWorld& world) {
    const std::vector<std::uint32_t> seeds(std::max<std::size_t>(1, world.games.size()), 0);
    return all_but_memory_as_config_error([&] { return world.make(seeds); });
}

void check_late_updates(const TrainingProgram& program) {
    const auto& train = program.settings.train;
    if (program.learns_beside || program.updates_late || !(train.overlap || train.realtime)) return;
    throw ConfigError(fmt::format(
        "{}: this agent must learn between a step and the next decision, so its environments cannot go on "
        "meanwhile: set it to false",
        train.overlap ? "train.overlap" : "train.realtime"));
}

void check_precision(const AgentSpec& spec) {
    if (spec.precision == Precision::float32 || !spec.device.is_cpu() || multiplies_bf16()) return;
    throw ConfigError(
        "train.precision: bf16 is slower than float32 on this processor, which has neither AVX512-BF16 nor "
        "AMX; set it to float32, or choose a GPU with --device cuda");
}

/// Before anything large is made: its initial values alone can take minutes.
void check_memory(const TrainingProgram& program, const TrainingWorld& world, const AgentSpec& spec,
                  int processes_here) {
    const auto available = available_memory() / processes_here;  // an equal share for each
    const auto environments = world.bytes_per_env * spec.num_envs;
    if (environments > available)
        refuse_memory(fmt::format("{} environments", spec.num_envs), environments, available,
                      "lower env.num_envs");
    if (program.check_memory) program.check_memory(spec, available - environments);
}

using Facts = std::vector<std::pair<std::string, std::string>>;

/// The description of a run for its console header.
Facts header_of(const TrainingProgram& program, const TrainingWorld& world, const ActionSpace& actions,
                const fs::path& run_dir, const std::string& machine) {
    const auto steps = program.settings.train.total_steps;
    Facts facts{
        {"encoder", program.table.has("agent.encoder") ? program.table.at("agent.encoder").get() : "-"}};
    for (auto& fact : world.facts(actions)) facts.push_back(std::move(fact));
    facts.insert(facts.end(), {{"agent steps", fmt::format("{} = {} frames", grouped(steps),
                                                           grouped(steps * world.frames_per_step))},
                               {"environments", fmt::format("{}", world.num_envs)},
                               {"device", machine},
                               {"seed", fmt::format("{}", program.settings.train.seed)}});
    for (const auto* key : kWaitsForUpdate) {
        if (!program.table.has(key)) continue;
        const auto first = number_in<std::int64_t>(program.table.at(key).get());
        if (first && ends_before_first_update(static_cast<double>(*first), static_cast<double>(steps)))
            facts.emplace_back(
                "updates", fmt::format("none: they begin after {} = {} transitions", key, grouped(*first)));
    }
    if (const auto& eval = program.settings.eval; eval.episodes > 0)
        facts.emplace_back(
            "evaluation",
            fmt::format("{} at the end{}", counted(eval.episodes, "game"),
                        eval.every > 0 ? fmt::format(", and every {} steps", grouped(eval.every)) : ""));
    facts.emplace_back("run folder", run_dir.string());
    return facts;
}

/// Makes the world one of real time, where train.realtime is set.
void apply_real_time(const TrainingProgram& program, TrainingWorld& world) {
    if (!program.settings.train.realtime) return;
    if (!world.make_real_time) throw ConfigError("train.realtime: this world has no clock: set it to false");
    world.make = world.make_real_time;
}

TrainingWorld make_world(const TrainingProgram& program) {
    return all_but_memory_as_config_error([&] {
        auto world = program.world();
        apply_real_time(program, world);
        return world;
    });
}

/// What the agent is made for. Throws ConfigError if it cannot be had here.
AgentSpec checked_spec(const TrainingProgram& program, const TrainingWorld& world,
                       const ProcessGroup& processes, torch::Device device, int processes_here) {
    AgentSpec spec = program.spec();
    spec.num_envs /= processes.size();
    spec.processes = &processes;
    {
        const auto one = make_one(world);
        spec.action_space = one->action_space();
        spec.observation = one->observation_space();
    }
    spec.device = device;
    check_late_updates(program);
    check_precision(spec);
    check_memory(program, world, spec, processes_here);
    return spec;
}

/// The run's own metadata: those of `resumed`, or new ones where it had none. Before the first step of a run
/// also writes the files that say what it is.
Metadata begin_record(const TrainingProgram& program, const TrainingWorld& world, const fs::path& run_dir,
                      std::optional<Metadata> resumed, bool resume, const Session& session) {
    if (!resume) require_no_run(run_dir);  // that came and went while the agent was made
    auto metadata = resumed ? std::move(*resumed)
                            : Metadata(run_dir,
                                       {.program = program.name,
                                        .agent = program.agent_name,
                                        .env_id = world.id,
                                        .seed = program.settings.train.seed,
                                        .roms = world.roms},
                                       session);
    metadata.set_schedule_over_run(program.schedule_over_run());
    if (!resume) {
        metadata.write();  // in this order: see require_no_run()
        write_file_atomically(run_dir / "config.yaml", program.table.to_yaml());
    }
    return metadata;
}

/// Records that the run is resumed, with these changes of its configuration, and prints what is not as
/// before.
void record_resumption(const TrainingProgram& program, const fs::path& run_dir, const Session& session,
                       const std::string& changes, double trained_seconds, Metadata& metadata) {
    const auto earlier = metadata.device();
    if (earlier && earlier->starts_with("cuda") != session.device.starts_with("cuda"))
        std::fprintf(stderr,
                     "%s: the run was trained on %s and continues on %s: its numbers differ from here on\n",
                     program.name.c_str(), earlier->c_str(), session.device.c_str());
    const auto threads = metadata.threads();
    if (threads && *threads != session.threads)
        std::fprintf(
            stderr,
            "%s: the run was trained with --threads %d and continues with %d: its numbers may differ from "
            "here on\n",
            program.name.c_str(), *threads, session.threads);
    write_file_atomically(run_dir / "config.yaml", program.table.to_yaml());
    metadata.resume(session, trained_seconds);
    if (!changes.empty()) metadata.add_change(changes);
    metadata.write();
    if (!changes.empty())
        std::fprintf(stderr, "%s: changed in mid-run: %s\n", program.name.c_str(), changes.c_str());
}

/// Returns the options of train(), without its callbacks.
TrainOptions train_options(const TrainingProgram& program, const CommandLine& line, const fs::path& run_dir,
                           const ProcessGroup& processes, const AcceptedChanges& changes, bool finished) {
    TrainOptions options;
    options.run_dir = run_dir;
    options.processes = processes;
    options.learns_beside = program.learns_beside;
    options.resume = line.resume;
    options.until = line.until;
    options.changed = !changes.different.empty();
    options.finished = finished;
    options.evaluates_otherwise = changes.evaluates_otherwise;
    options.config = program.table.to_yaml();
    options.progress_bar = line.progress;
    options.agent_name = program.agent_name;
    for (const auto& entry : program.table.entries())
        options.hyperparameters.emplace_back(entry.key, entry.get());
    return options;
}

/// A run may be resumed in another folder than the one that its folder of ROMs was relative to.
void make_rom_dir_absolute(const ConfigTable& table) {
    constexpr std::string_view kKey = "env.rom_dir";
    if (!table.has(kKey)) return;  // another world than the console's
    const auto& setting = table.at(kKey);
    if (const auto folder = setting.get(); !folder.empty()) setting.set(fs::absolute(folder).string());
}

int run(const TrainingProgram& program, int argc, const char* const* argv) {
    if (!is_agent_name(program.agent_name))
        throw ConfigError(
            fmt::format("an agent cannot be called '{}' in run_program(): its name takes at most 64 letters, "
                        "digits, '_' and '-'",
                        program.agent_name));
    const CommandLine line =
        parse_command_line(program.name, program.description, program.table, argc, argv, std::cout);
    if (line.finished) {
        flush_standard_output();
        return kDone;
    }

    prepare_process_for_training();
    make_rom_dir_absolute(program.table);
    const TrainingWorld world = make_world(program);
    const auto process = find_rank(program, world);
    const torch::Device device = choose_device(line.device, process);
    // What LibTorch allocates without an explicit device, such as pinned memory, belongs to the current one.
    if (device.has_index()) c10::impl::VirtualGuardImpl(device.type()).setDevice(device);

    const ProcessGroup processes = join_processes(process, program, device);
    fs::path run_dir = choose_run_dir(line, program, world);
    const auto changes = line.resume ? accepted_changes(program, run_dir, line) : AcceptedChanges{};
    std::optional<RunLock> lock;  // before a session that is about to end writes what is read here
    if (line.resume && processes.first()) lock.emplace(run_dir);
    auto resumed = line.resume ? read_metadata(run_dir) : std::nullopt;
    const bool finished = resumed && resumed->finished();
    const int processes_here = process ? process->local_size : 1;
    const int threads =
        broadcast_threads(choose_threads(line, program, world, resumed, run_dir, processes_here), processes);
    at::set_num_threads(threads);
    const AgentSpec spec = checked_spec(program, world, processes, device, processes_here);

    std::optional<NewFolder> folder;  // the other processes of a run write nothing
    if (!line.resume && processes.first()) {
        folder.emplace(make_run_dir(line, run_dir));
        run_dir = folder->path();
    }
    // Networks and environments may take a while to make.
    if (processes.first()) {
        Console(stderr).header(
            fmt::format("{} on {}", program.agent_name, world.id),
            header_of(
                program, world, spec.action_space, run_dir,
                fmt::format("{}, {}{}", device.str(), counted(threads, "thread"),
                            processes.single() ? "" : fmt::format(", {} processes", processes.size()))));
    }
    const std::unique_ptr<Agent> agent =
        invalid_argument_as_config_error([&] { return program.make_agent(spec); });
    const Session session{.command = shell_text(std::vector<std::string>(argv, argv + argc)),
                          .device = device.str(),
                          .threads = threads,
                          .processes = static_cast<int>(processes.size())};
    std::optional<Metadata> metadata;
    if (processes.first()) {
        if (!lock) lock_new_run(run_dir, lock);
        metadata.emplace(begin_record(program, world, run_dir, std::move(resumed), line.resume, session));
    }

    TrainOptions options = train_options(program, line, run_dir, processes, changes, finished);
    options.checkpointed = [&] { metadata->write(); };
    options.resumed = [&](double trained_seconds) {
        record_resumption(program, run_dir, session, changes.different, trained_seconds, *metadata);
    };
    const StopSignals signals;  // until the end is recorded
    return train_for_exit_code(*agent, world, program.settings, options, metadata ? &*metadata : nullptr,
                               changes.different);
}

}  // namespace

int run_program(const TrainingProgram& program, int argc, const char* const* argv) {
    open_standard_streams();
    const auto fail = [&](const std::exception& error, ExitCode code) {
        std::fprintf(stderr, "%s: %s\n", program.name.c_str(), failure_sentence(error).c_str());
        return code;
    };
    try {
        return run(program, argc, argv);
    } catch (const ConfigError& error) {
        return fail(error, kUsage);
    } catch (const UnreadableNow& error) {
        return fail(error, kFailed);
    } catch (const ResumeError& error) {
        return fail(error, kCannotResume);
    } catch (const CutFile& error) {
        return fail(error, kCannotResume);
    } catch (const Diverged& error) {
        return fail(error, kDiverged);
    } catch (const std::exception& error) {
        return fail(error, kFailed);
    }
}

}  // namespace cale
