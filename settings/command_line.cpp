#include "settings/command_line.h"

#include <algorithm>
#include <filesystem>
#include <ostream>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include "cale/setting.h"
#include "cale/text.h"
#include "settings/agent_of_config.h"
#include "settings/peer_names.h"
#include "settings/versions.h"
#include "storage/metadata_text.h"
#include "terminal/columns.h"

namespace cale {
namespace {

constexpr TrainOption kOptions[] = {
    {"--config", "FILE.yaml", "read settings from this YAML file"},
    {"--set", "KEY=VALUE", "change one setting; plain KEY=VALUE does the same"},
    {"--env-id", "GAME", "the game: pong, Pong or ALE/Pong-v5; PongNoFrameskip-v4: without sticky actions",
     "env.game"},
    {"--total-timesteps", "N", "agent steps to train for", "train.total_steps"},
    {"--num-envs", "N", "environments that step together", "env.num_envs"},
    {"--seed", "N", "everything random follows from it", "train.seed"},
    {"--run-dir", "DIR", "folder for everything that the run writes"},
    {"--resume", "", "continue the run in --run-dir from its newest good checkpoint"},
    {"--accept-changes", "", "with --resume: continue although settings of the agent or the training differ"},
    {"--until", "STEP", "pause at this agent step: write a checkpoint, to resume from, and leave"},
    {"--device", "DEVICE", "auto, cpu, cuda or cuda:<index>; auto: cuda if there is one"},
    {"--threads", "N",
     "threads for tensors: a number, or auto: measured at the start; one where the agent sees no images"},
    {"--no-progress", "", "no progress bar"},
    {"--print-config", "", "check the settings, print all of them as YAML, and leave"},
    {"--or", "",
     "with --print-config: start another YAML document, to which only the KEY=VALUE after this one apply"},
    {"--version", "", "print the versions, and leave"},
    {"--help", "", "print this text, and leave"},
};

// ---- help ---------------------------------------------------------------------------

std::string setting_text(const ConfigEntry& entry) {
    auto text = entry.type;
    if (!entry.range_text.empty()) text += ", " + entry.range_text;
    return text + ", default " + (entry.default_text.empty() ? "empty" : entry.default_text);
}

// ---- options ------------------------------------------------------------------------

void check_device(const std::string& device) {
    const bool with_index =
        device.starts_with("cuda:") && number_in<std::uint64_t>(std::string_view(device).substr(5));
    if (device != "auto" && device != "cpu" && device != "cuda" && !with_index) {
        throw ConfigError(fmt::format("--device must be auto, cpu, cuda or cuda:<index>, not '{}'", device));
    }
}

void check_threads(const std::string& threads) {
    const auto number = number_in<std::uint64_t>(threads);
    if (threads != "auto" && !(number && *number >= 1 && *number <= kMostThreads)) {
        throw ConfigError(
            fmt::format("--threads must be auto or a number from 1 to {}, not '{}'", kMostThreads, threads));
    }
}

std::int64_t agent_step(const std::string& until) {
    std::int64_t step = 0;
    try {
        read_setting("--until", {.low = 1, .high = 1e12}, until, &step);
    } catch (const std::invalid_argument& error) {
        throw ConfigError(error.what());
    }
    return step;
}

std::string unknown_option(std::string_view argument, const ConfigTable& table) {
    const auto name = argument.substr(0, argument.find('='));
    std::string word(name.substr(std::min(name.size(), name.find_first_not_of('-'))));
    std::ranges::replace(word, '-', '_');
    const auto peer = key_of_peer(word, table.entries());
    for (const auto& entry : table.entries()) {
        if (word == entry.key || peer == entry.key || entry.key.ends_with("." + word))
            return fmt::format("unknown option '{}'; settings are given as KEY=VALUE: {}={}", name, entry.key,
                               entry.get());
    }
    std::vector<std::string> names;
    for (const auto& option : train_options(table)) names.emplace_back(option.name);
    return fmt::format("unknown option '{}'{}", name, did_you_mean(name, names));
}

/// The options and their arguments, nothing applied yet.
struct Arguments {
    CommandLine line;
    std::vector<std::pair<TrainOption, std::string>> shortcuts;  // options that set a key
    std::vector<std::vector<std::string>> alternatives;          // to line.overrides: one for every --or
    bool help = false;
    bool version = false;
    bool print_config = false;
};

/// Each of them reads the file of --config again.
void check_alternatives(const Arguments& arguments) {
    if (arguments.alternatives.empty()) return;
    if (!arguments.print_config) throw ConfigError("--or is for --print-config");
    const std::filesystem::path file = arguments.line.config_file;
    std::error_code ignored;
    if (std::filesystem::exists(file, ignored) && !std::filesystem::is_regular_file(file, ignored))
        throw ConfigError(fmt::format(
            "--or reads --config {} again, which is no regular file; give it a file", file.string()));
}

/// Adds each KEY=VALUE to the overrides, or to those of the newest --or. Refuses anything else.
void sort_settings(const std::vector<std::string>& words, const ConfigTable& table, Arguments& arguments) {
    const auto set = arguments.line.overrides;  // by --set
    for (const auto& word : words) {
        if (word == "--or") {
            arguments.alternatives.push_back(set);
            continue;
        }
        if (word.starts_with("-")) throw ConfigError(unknown_option(word, table));
        if (word.find('=') == std::string::npos) {
            const bool is_file = word.ends_with(".yaml") || word.ends_with(".yml");
            throw ConfigError(fmt::format("unexpected argument '{}'; {}", word,
                                          is_file ? "a file of settings is given by --config FILE"
                                          : std::filesystem::is_directory(word)
                                              ? "the folder of a run is given by --run-dir DIR"
                                              : "settings are given as KEY=VALUE"));
        }
        auto& overrides =
            arguments.alternatives.empty() ? arguments.line.overrides : arguments.alternatives.back();
        overrides.push_back(word);
    }
}

Arguments parse_arguments(const ConfigTable& table, int argc, const char* const* argv) {
    Arguments arguments;
    CommandLine& line = arguments.line;
    bool no_progress = false;
    std::string until;

    CLI::App app;
    app.set_help_flag();
    app.allow_extras();
    app.option_defaults()->take_last();  // scripts append options to change earlier ones
    app.add_option("--config", line.config_file);
    app.add_option("--set", line.overrides)->allow_extra_args(false)->take_all();
    app.add_option("--run-dir", line.run_dir);
    app.add_option("--until", until);
    app.add_option("--device", line.device);
    app.add_option("--threads", line.threads);
    for (const auto& [name, flag] : {std::pair("--resume", &line.resume),
                                     {"--accept-changes", &line.accept_changes},
                                     {"--no-progress", &no_progress},
                                     {"--print-config", &arguments.print_config},
                                     {"--version", &arguments.version},
                                     {"-h,--help", &arguments.help}})
        app.add_flag(name, *flag)->disable_flag_override();
    for (const auto& option : train_options(table)) {
        if (option.key.empty()) continue;
        app.add_option_function<std::string>(std::string(option.name),
                                             [&arguments, option](const std::string& value) {
                                                 arguments.shortcuts.emplace_back(option, value);
                                             });
    }
    for (auto* option : app.get_options()) {
        option->check([](const std::string& value) {
            if (value.empty()) return std::string("needs a value that is not empty");
            return value.starts_with("--") ? "'" + value + "' is an option, not a value" : std::string();
        });
    }
    check_option_values(std::vector<std::string>(argv, argv + argc));
    try {
        app.parse(argc, argv);
    } catch (const CLI::ArgumentMismatch& error) {
        const std::string_view what = error.what();      // "--seed: 1 required TEXT missing"
        if (what.ends_with("disallowed flag override"))  // "resume was given a disallowed flag override"
            throw ConfigError(fmt::format("--{} takes no value", what.substr(0, what.find(' '))));
        throw ConfigError(fmt::format("{} needs a value", what.substr(0, what.find(':'))));
    } catch (const CLI::ParseError& error) {
        throw ConfigError(error.what());
    }
    line.progress = !no_progress;

    if (app.get_option("--config")->count() > 1)
        throw ConfigError(
            "--config is given more than once: a file that has 'extends: [FIRST.yaml, SECOND.yaml]' reads "
            "both");
    sort_settings(app.remaining(), table, arguments);
    check_alternatives(arguments);
    check_device(line.device);
    check_threads(line.threads);
    if (!until.empty()) line.until = agent_step(until);
    if (line.resume && line.run_dir.empty()) {
        throw ConfigError("--resume needs --run-dir DIR, the folder of the run to continue");
    }
    if (line.accept_changes && !line.resume) throw ConfigError("--accept-changes is for --resume");
    return arguments;
}

/// Another agent's run has settings that this program does not know.
void check_trained_by(std::string_view program, const std::filesystem::path& run_dir) {
    const auto trained_by = metadata_text(run_dir, "program");
    if (trained_by.empty() || trained_by == program) return;
    throw ConfigError(fmt::format("--resume --run-dir {}: this is a run of {}; resume it with that program",
                                  run_dir.string(), trained_by));
}

/// Reads the file; where it cannot be, the sentence names the program that it is for.
void load(ConfigTable& table, const std::filesystem::path& file) {
    try {
        table.load(file);
    } catch (const ConfigError& error) {
        std::error_code ignored;
        // What comes out of a pipe has been read.
        if (!std::filesystem::is_regular_file(file, ignored)) throw;
        const auto programs = programs_that_take(file);
        if (programs.empty()) throw;
        const std::string_view what = error.what();
        throw ConfigError(fmt::format("{}; this is a configuration of {}",
                                      what.substr(0, what.find("; did you mean")),  // a key of this program
                                      fmt::join(programs, " or ")));
    }
}

/// Gymnasium's ids that end with -v4 have no sticky actions.
void apply_version(const Arguments& arguments, ConfigTable& table) {
    for (const auto& [option, value] : arguments.shortcuts) {
        if (option.key == "env.game" && value.ends_with("-v4")) table.at("env.sticky_probability").set("0");
    }
}

/// Puts the file, the overrides and the shortcuts into the table, in the order of their precedence.
void apply(std::string_view program, Arguments& arguments, ConfigTable& table) {
    CommandLine& line = arguments.line;
    const bool of_the_run = line.resume && line.config_file.empty();
    if (of_the_run) {
        check_trained_by(program, line.run_dir);
        const auto saved = std::filesystem::path(line.run_dir) / "config.yaml";
        if (std::filesystem::exists(saved))
            line.config_file = saved.string();
        else if (arguments.print_config)
            throw ConfigError(
                fmt::format("--resume --run-dir {}: there is no {}", line.run_dir, saved.string()));
    }
    if (!line.config_file.empty()) {
        try {
            load(table, line.config_file);
        } catch (const ConfigError& error) {
            if (!of_the_run) throw;
            throw ConfigError(fmt::format("{}; the run's checkpoints have copies of it", error.what()));
        }
    }
    apply_version(arguments, table);
    for (const auto& setting : line.overrides) table.set_override(setting);
    for (const auto& [option, value] : arguments.shortcuts) {
        try {
            table.at(option.key).set(value);
        } catch (const ConfigError& error) {
            throw ConfigError(fmt::format("{} {}: {}", option.name, value, error.what()));
        }
    }
    try {
        table.validate();
    } catch (const ConfigError& error) {
        const bool as_the_file_is = line.overrides.empty() && arguments.shortcuts.empty();
        if (!of_the_run || line.config_file.empty() || !as_the_file_is) throw;
        throw ConfigError(fmt::format("{} (with {}, of which the run's checkpoints have copies)",
                                      error.what(), line.config_file));
    }
}

/// One YAML document after another: the settings as they are, then those of every alternative. What comes
/// before one that is wrong has been printed.
void print_configs(std::string_view program, Arguments& arguments, ConfigTable& table, std::ostream& out) {
    out << table.to_yaml();
    for (const auto& alternative : arguments.alternatives) {
        arguments.line.overrides = alternative;
        table.reset();
        apply(program, arguments, table);
        out << "---\n" << table.to_yaml();
    }
}

}  // namespace

void check_option_values(std::span<const std::string> words) {
    for (const auto& word : words) {
        const auto equals = word.find('=');
        if (!word.starts_with("--") || equals == word.npos) continue;
        const auto option = word.substr(0, equals);
        const auto value = word.substr(equals + 1);
        if (value.empty()) throw ConfigError(option + ": needs a value that is not empty");
        if (value.starts_with("~/"))
            throw ConfigError(fmt::format("{}: a shell replaces ~ only at the start of a word: write {} {}",
                                          word, option, value));
    }
}

c10::Device find_device(const std::string& requested, std::uint64_t gpus,
                        std::optional<std::uint64_t> own_index) {
    check_device(requested);
    if (requested == "cpu" || (requested == "auto" && gpus == 0)) return c10::kCPU;
    if (gpus == 0) {
        throw ConfigError(
            fmt::format("--device {}: this LibTorch finds no CUDA device; use --device cpu, or scripts/setup "
                        "--cuda on a machine with an NVIDIA GPU",
                        requested));
    }
    const auto colon = requested.find(':');
    const auto index = colon == requested.npos
                           ? own_index
                           : number_in<std::uint64_t>(std::string_view(requested).substr(colon + 1));
    if (!index) return c10::kCUDA;
    if (*index >= gpus) {
        throw ConfigError(
            fmt::format("--device {}: cuda:{} is not there; this machine has {}, counted from 0", requested,
                        *index, gpus));
    }
    return {c10::kCUDA, static_cast<c10::DeviceIndex>(*index)};
}

std::string version_text(std::string_view program) {
    return fmt::format("{} {} (LibTorch {}, ALE {})", program, cale_version(), torch_version(),
                       ale_version());
}

std::vector<TrainOption> train_options(const ConfigTable& table) {
    std::vector<TrainOption> options;
    for (const auto& option : kOptions) {
        if (option.key.empty() || table.has(option.key)) options.push_back(option);
    }
    return options;
}

std::string help_text(std::string_view program, std::string_view description, const ConfigTable& table,
                      std::size_t width) {
    constexpr std::size_t column = 28;
    auto text = wrap(fmt::format("{}: {}", program, description), 0, width);
    text += fmt::format("\nusage: {} [--config FILE] [KEY=VALUE ...] [options]\n\noptions:\n", program);
    for (const auto& option : train_options(table)) {
        const auto help =
            option.key.empty() ? std::string(option.help) : fmt::format("{} ({})", option.help, option.key);
        text += two_columns(fmt::format("{} {}", option.name, option.value), help, column, width);
    }
    text += '\n';
    text += wrap(
        "settings, as KEY=VALUE on the command line, such as train.total_steps=1e6; in a file as 'name: "
        "value' below 'section:'",
        0, width);
    std::string_view section;
    for (const auto& entry : table.entries()) {
        const auto entry_section = std::string_view(entry.key).substr(0, entry.key.find('.'));
        if (entry_section != section) text += fmt::format("\n{}\n", entry_section);
        section = entry_section;
        text +=
            two_columns(entry.key, fmt::format("{} [{}]", entry.help, setting_text(entry)), column, width);
    }
    text += fmt::format(
        "\nexamples:\n"
        "  {0} --config FILE.yaml --run-dir runs/breakout\n"
        "  {0} --resume --run-dir runs/breakout\n"
        "  {0} --config FILE.yaml --print-config\n\n",
        program);
    return text + wrap(
                      "exit codes: 0 done, 1 failed, 2 usage, 3 cannot resume, 4 diverged, 130 interrupted "
                      "after a checkpoint",
                      0, width);
}

CommandLine parse_command_line(std::string_view program, std::string_view description, ConfigTable& table,
                               int argc, const char* const* argv, std::ostream& out) {
    Arguments arguments;
    try {
        arguments = parse_arguments(table, argc, argv);
    } catch (const ConfigError& error) {
        throw ConfigError(fmt::format("{} (see {} --help)", error.what(), program));
    }
    CommandLine& line = arguments.line;
    line.finished = arguments.help || arguments.version || arguments.print_config;
    if (arguments.help) {
        out << help_text(program, description, table, terminal_width());
    } else if (arguments.version) {
        out << version_text(program) << '\n';
    } else {
        apply(program, arguments, table);
        if (arguments.print_config) print_configs(program, arguments, table, out);
    }
    return line;
}

}  // namespace cale
