// The command line that all training programs share. Its --help is made from the same
// table of settings that reads the configuration files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <c10/core/Device.h>

#include "settings/config.h"

namespace cale {

/// The largest --threads.
inline constexpr int kMostThreads = 4096;

/// An option of the training programs as --help shows it. Those with a `key` are another way to set that key.
struct TrainOption {
    std::string_view name;
    std::string_view value;  // what it takes: FILE.yaml, GAME, N, ...; empty: nothing
    std::string_view help;
    std::string_view key = "";
};

/// The options that a program with these settings has, in the order of its --help.
std::vector<TrainOption> train_options(const ConfigTable& table);

/// What the command line of a training program says.
struct CommandLine {
    std::string config_file;             // empty: the defaults alone
    std::vector<std::string> overrides;  // KEY=VALUE: those of --set, then the plain ones, each in order
    std::string run_dir;                 // empty: the program chooses one
    bool resume = false;
    bool accept_changes = false;   // resume although settings differ
    std::int64_t until = 0;        // agent step at which to pause; 0: none
    std::string device = "auto";   // auto, cpu, cuda or cuda:<index>
    std::string threads = "auto";  // auto or a number from 1
    bool progress = true;
    bool finished = false;  // --help, --version or --print-config was handled: exit with code 0
};

/// Reads the command line, the configuration file and the overrides into the table's structs. In ascending
/// order of precedence: the structs' defaults, the file of --config, --set and KEY=VALUE, and dedicated
/// options such as --seed and --num-envs. --resume without --config uses the config.yaml of the run folder,
/// if there is one.
/// --help, --version and --print-config are written to `out`. Behind --print-config, A=1 --or A=2 are two
/// configurations, of which every one is checked and printed, one YAML document after another.
/// Throws ConfigError, one sentence, for any error.
CommandLine parse_command_line(std::string_view program, std::string_view description, ConfigTable& table,
                               int argc, const char* const* argv, std::ostream& out);

/// Throws ConfigError where a word is "--option=" without a value, since CLI11 would take the next word for
/// it, or "--option=~/...", where shells leave the ~ as it is: files would go to a folder of that name.
void check_option_values(std::span<const std::string> words);

/// Returns the device that --device requests: auto (cuda if available), cpu, cuda or cuda:<index>, on a
/// machine with `gpus` GPUs (at::getNumGPUs()). `own_index` is the index that plain cuda stands
/// for; without it, the current device. Throws ConfigError for another name and for a device that does not
/// exist.
c10::Device find_device(const std::string& requested, std::uint64_t gpus,
                        std::optional<std::uint64_t> own_index = std::nullopt);

/// "train_sac 0.1.0 (LibTorch 2.11.0, ALE 0.12.1)"
std::string version_text(std::string_view program);

/// What --help prints, wrapped to `width` columns.
std::string help_text(std::string_view program, std::string_view description, const ConfigTable& table,
                      std::size_t width);

}  // namespace cale
