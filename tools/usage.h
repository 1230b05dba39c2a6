// What the commands of `cale` share: checks of options, of files and folders that are written, and of
// environments. Each error is one sentence with the option, the value and the remedy.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>

#include "cale/env.h"
#include "storage/new_folder.h"

namespace cale {

// Validators for CLI::Option::transform(). CLI11's own checks accept nan in any range, -1 as a large number
// and 010 as 8.

/// Whole numbers from `least` to `most`.
CLI::Validator whole_numbers(std::int64_t least, std::int64_t most);
/// Numbers from `least` to `most`.
CLI::Validator numbers(double least, double most);
/// The seeds that train_* take.
CLI::Validator seeds();
/// One of these words.
CLI::Validator one_of(const std::vector<std::string>& words);

/// Makes every option of the program and its commands reject an empty text, or another option, as its value.
void refuse_forgotten_values(CLI::App& program);

/// Throws ConfigError unless `word`, the first after the program's name, is a command or an option of it.
void check_first_word(const CLI::App& program, const std::string& word);

/// The program and the command that its command line named: "cale evaluate".
std::string name_with_command(const CLI::App& program);

/// Returns a sentence on what a command line lacks, or has too much of.
std::string usage_sentence(const CLI::App& program, const CLI::ParseError& error);

/// --set of the commands that have an environment and no agent. Throws ConfigError.
void set_environment(EnvConfig& env, const std::vector<std::string>& settings);

/// --config of these commands: a YAML file with a section env alone. Throws ConfigError.
void load_environment(EnvConfig& env, const std::filesystem::path& file);

/// Throws ConfigError where the ROM of one of the environment's games is missing.
void check_roms(const EnvConfig& env);

/// Creates the folder that `option` names, or the command's default; see NewFolder, which removes it again
/// while it is empty. Throws ConfigError with the reason if that fails.
[[nodiscard]] NewFolder make_output_folder(std::string_view option, const std::filesystem::path& folder);

/// Returns share/cale/`name` beside the program where cmake --install put it, else `built`, its place in the
/// source tree or the build folder.
std::filesystem::path shared_path(const std::filesystem::path& name, const std::filesystem::path& built);

/// Throws ConfigError with the reason if the file that `option` names cannot be written. Must be called
/// before the work whose result goes there.
void check_output_file(std::string_view option, const std::filesystem::path& file);

/// The same for write_picture(), whose files are .svg or .png.
void check_picture_file(std::string_view option, const std::filesystem::path& file);

}  // namespace cale
