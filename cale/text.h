// Text functions for reading names and tables.
#pragma once

#include <concepts>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cale/number.h"

namespace cale {

/// Returns the parts between the separators: one more than there are separators; any may be empty.
std::vector<std::string> split(std::string_view text, char separator);

/// Returns "1 run", or "3 runs".
std::string counted(std::integral auto count, std::string_view noun) {
    return std::to_string(count).append(" ").append(noun).append(count == 1 ? "" : "s");
}

/// Returns the length of the UTF-8 character that the text (not empty) begins with; 0 if it begins with none.
std::size_t utf8_length(std::string_view text);
/// Returns whether a byte of UTF-8 belongs to the character before it.
constexpr bool continues_character(char byte) {
    return (static_cast<unsigned char>(byte) & 0xC0) == 0x80;
}
/// Returns the text as one line without terminal control sequences: control characters (C0, DEL, C1) and
/// bytes that are not UTF-8 are written as \x1b. For any text quoted from a file.
std::string printable(std::string_view text);

/// Returns the edit distance of two words: letters inserted, deleted, replaced, or swapped with their
/// neighbour (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b);

/// Returns whether `a` comes before `b` where numbers in them are compared as numbers: "n=3", "n=10".
bool natural_less(std::string_view a, std::string_view b);

/// Returns the text with A to Z as a to z.
std::string lower(std::string_view text);
/// The candidate that `text` is probably a misspelling of, by edit distance; empty if none is near.
std::string nearest(std::string_view text, std::span<const std::string> candidates);
/// Returns "; did you mean 'CANDIDATE'?" with the nearest one; empty if none is near.
std::string did_you_mean(std::string_view text, std::span<const std::string> candidates);

}  // namespace cale
