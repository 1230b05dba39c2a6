// Error messages of programs.
#pragma once

#include <exception>
#include <string>

namespace cale {

/// Returns whether memory ran out, on the CPU or on a GPU.
bool is_out_of_memory(const std::exception& error);

/// Returns whether the machine caused it, and not what ran on it: a disk or memory is full, a file is
/// forbidden or cannot be read.
bool is_of_the_machine(const std::exception& error);

/// Returns the error as one printable() sentence: what() for most errors. LibTorch's come without their stack
/// trace; errors of exhausted memory and of files come with a remedy. `may_move`: whether choosing
/// another folder can be one.
std::string failure_sentence(const std::exception& error, bool may_move = true);

}  // namespace cale
