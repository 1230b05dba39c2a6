// What `cale` makes of words that it cannot use: one sentence with the option, the value and the way out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>

#include "cale/env.h"

namespace cale {

// What an option takes, to be given to CLI::Option::transform(). CLI11's own checks take nan for a number of
// any range, -1 for a large one and 010 for 8.

/// Whole numbers from `least` to `most`.
CLI::Validator whole_numbers(std::int64_t least, std::int64_t most);
/// Numbers from `least` to `most`.
CLI::Validator numbers(double least, double most);
/// The seeds that train_* take.
CLI::Validator seeds();
/// One of these words.
CLI::Validator one_of(const std::vector<std::string>& words);

/// Lets no option of the program and its commands take an empty text, or another option, for its value.
void refuse_forgotten_values(CLI::App& program);

/// Throws ConfigError unless `word`, the first after the program's name, is a command or an option of it.
void check_first_word(const CLI::App& program, const std::string& word);

/// The program and the command that its command line named: "cale evaluate".
std::string name_with_command(const CLI::App& program);

/// What a command line lacks, or has too much.
std::string usage_sentence(const CLI::App& program, const CLI::ParseError& error);

/// --set of the commands that have an environment and no agent. Throws ConfigError.
void set_environment(EnvConfig& env, const std::vector<std::string>& settings);

/// Makes the folder that `option` names, or the command chose in its place. Throws ConfigError with the
/// reason where that cannot be.
void make_output_folder(std::string_view option, const std::filesystem::path& folder);

/// Throws ConfigError with the reason where the file that `option` names cannot be written. To be asked
/// before the work is done whose result goes there.
void check_output_file(std::string_view option, const std::filesystem::path& file);

}  // namespace cale
