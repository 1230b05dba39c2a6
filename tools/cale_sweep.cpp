#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <ATen/Context.h>

#include "settings/config.h"
#include "sweep/sweep.h"
#include "tools/commands.h"
#include "tools/usage.h"

namespace cale {
namespace {

/// What the options say, before it is put into SweepOptions.
struct Arguments {
    SweepOptions options;
    double memory = 0;  // GB
    std::vector<std::string> devices = {"auto"};
    std::string launcher = "local", search = "none";
    bool dry_run = false, status = false, no_progress = false;
};

SweepOptions options_of(const Arguments& arguments) {
    auto options = arguments.options;
    if (!options.sbatch_options.empty() && arguments.launcher != "slurm")
        throw ConfigError("--sbatch-option is for --launcher slurm");
    options.cale = std::filesystem::read_symlink("/proc/self/exe");
    options.launcher = arguments.launcher == "slurm" ? Launcher::slurm : Launcher::local;
    options.search = arguments.search == "random"    ? SearchMethod::random
                     : arguments.search == "halving" ? SearchMethod::halving
                                                     : SearchMethod::none;
    options.task = arguments.status    ? SweepTask::show_status
                   : arguments.dry_run ? SweepTask::show_commands
                                       : SweepTask::train;
    options.live_table = !arguments.no_progress;
    options.sharing.memory_per_run = static_cast<std::int64_t>(arguments.memory * 1e9);
    if (arguments.devices != std::vector<std::string>{"auto"}) options.sharing.devices = arguments.devices;
    options.gpus = static_cast<int>(at::getNumGPUs());
    return options;
}

void add_sharing(CLI::App& command, Arguments& arguments) {
    auto& sharing = arguments.options.sharing;
    command
        .add_option(
            "--jobs", sharing.jobs,
            "runs at once, with Slurm of each job array; 0: as many as cores, memory and GPUs allow, with "
            "Slurm as many as it gives")
        ->transform(whole_numbers(0, 100'000))
        ->type_name("N");
    command.add_option("--threads", sharing.threads, "threads of a run")
        ->transform(whole_numbers(1, 4096))
        ->type_name("N");
    command
        .add_option("--memory", arguments.memory,
                    "gigabytes that a run takes; 0: estimated from the replay that it will fill")
        ->transform(numbers(0, 1e5))
        ->type_name("GB");
    command
        .add_option("--device", arguments.devices,
                    "auto, cpu, or GPUs with commas between, such as cuda:0,cuda:2; auto: every GPU there "
                    "is, else cpu")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->default_str("auto")
        ->type_name("DEVICE");
    command.add_option("--per-gpu", sharing.per_gpu, "runs at once on a GPU")
        ->transform(whole_numbers(1, 1000))
        ->type_name("N");
}

}  // namespace

void add_sweep(CLI::App& app, int& exit_code) {
    auto& command =
        *app.add_subcommand("sweep",
                            "Trains every run of a comparison: agents, games, seeds and settings as a "
                            "file has them. Finished runs are left alone, interrupted ones are resumed.");
    const auto arguments = std::make_shared<Arguments>();
    auto& options = arguments->options;
    command.add_option("FILE", options.file, "what to run, such as sweeps/encoders.yaml")
        ->required()
        ->type_name("FILE.yaml");
    command
        .add_option("--set", options.overrides,
                    "values in the place of the file's: env.game=pong,breakout or train.seed=1..3")
        ->allow_extra_args(false)
        ->take_all()
        ->default_str("")
        ->type_name("KEY=VALUE");
    command.add_option("--dir", options.folder, "holds a folder for each run; else runs/<name of FILE>")
        ->type_name("DIR");
    command.add_option("--only", options.only, "only runs whose names match, such as 'Pong__*'")
        ->allow_extra_args(false)
        ->take_all()
        ->default_str("")
        ->type_name("PATTERN");
    command
        .add_option(
            "--search", arguments->search,
            "how to search the settings of the file's 'search:'; random: every sample is trained to the end; "
            "halving: the better half is trained twice as far, again and again")
        ->transform(one_of({"random", "halving"}))
        ->default_str("")
        ->type_name("METHOD");
    auto* dry_run =
        command.add_flag("--dry-run", arguments->dry_run, "print the commands, or Slurm's script, and leave");
    command.add_flag("--status", arguments->status, "print how every run stands, and leave")
        ->excludes(dry_run);
    add_sharing(command, *arguments);
    command
        .add_option("--retries", options.retries,
                    "how often a failed run is retried without further progress")
        ->transform(whole_numbers(0, 1000))
        ->type_name("N");
    command.add_flag("--no-progress", arguments->no_progress, "no live table");
    command
        .add_option("--launcher", arguments->launcher,
                    "local: on this machine; slurm: as job arrays, by the sbatch on the PATH")
        ->transform(one_of({"local", "slurm"}))
        ->type_name("NAME");
    command
        .add_option("--sbatch-option", options.sbatch_options,
                    "a further option of sbatch, such as --sbatch-option=--time=8:00:00")
        ->allow_extra_args(false)
        ->take_all()
        ->default_str("")
        ->type_name("OPTION");
    command.footer(
        "Ctrl-C stops all runs at a checkpoint; the same command resumes them.\n"
        "\n"
        "Examples:\n"
        "  cale sweep sweeps/encoders.yaml --set env.game=pong,breakout --set train.seed=1..3\n"
        "  cale sweep sweeps/encoders.yaml --status\n"
        "  cale sweep sweeps/agents_200m.yaml --per-gpu 4\n"
        "  cale sweep sweeps/agents.yaml --launcher slurm --sbatch-option=--partition=cpu\n"
        "  cale sweep sweeps/search.yaml --search halving\n"
        "  cale report runs/encoders\n"
        "\n"
        "Exit codes: 0 all runs finished, 1 some failed or are refused, 2 usage, 130 interrupted.");
    command.callback([arguments, &exit_code] { exit_code = run_sweep(options_of(*arguments), stdout); });
}

}  // namespace cale
