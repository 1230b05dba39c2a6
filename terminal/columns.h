// Text layout for a terminal, as for --help.
#pragma once

#include <cstddef>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

namespace cale {

/// Words of `text` in lines of at most `width` columns, each indented; a longer word has a line of its own.
std::string wrap(std::string_view text, std::size_t indent, std::size_t width);

/// `left` indented by two, `right` wrapped from column `column` on, below it where `left` is long.
std::string two_columns(std::string_view left, std::string_view right, std::size_t column, std::size_t width);

/// The size of a terminal in characters.
struct TerminalSize {
    std::size_t columns, rows;
};
/// Returns the size of the terminal behind `out`; none where it is no terminal, or one that does not say.
std::optional<TerminalSize> terminal_size(std::FILE* out);

/// Columns of the standard output's terminal, 40 to 120; 80 where there is none.
std::size_t terminal_width();

}  // namespace cale
