// Running other programs and reading their output.
#pragma once

#include <string>

namespace cale {

/// What a command printed, and how it ended.
struct Answer {
    int status = 0;  // of the shell, as waitpid() has it; 0: well
    std::string text;
};

/// What a shell command writes to its standard output. Throws std::runtime_error where it cannot be started.
Answer answer_of(const std::string& command);

/// What is before the line breaks at its end.
std::string without_line_end(std::string text);

}  // namespace cale
