// What a program says when something fails.
#pragma once

#include <exception>
#include <string>

namespace cale {

/// What went wrong, in one printable() sentence: what() for most errors. LibTorch's are given without their
/// stack trace, and those of memory that ran out and of files with the way out that they do not name
/// themselves.
std::string failure_sentence(const std::exception& error);

}  // namespace cale
