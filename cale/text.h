// What reading names and tables needs of text.
#pragma once

#include <charconv>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace cale {

/// The parts between the separators: one more than there are separators, of which any may be empty.
std::vector<std::string> split(std::string_view text, char separator);

/// The number that all of the text is; none if it is anything else, or does not fit.
template <class Number>
std::optional<Number> number_in(std::string_view text) {
    Number number{};
    const char* const end = text.data() + text.size();
    const auto [stopped, error] = std::from_chars(text.data(), end, number);
    if (error != std::errc{} || stopped != end) return std::nullopt;
    return number;
}

/// The text as one line that a terminal shows and does not obey: control characters (C0, DEL, C1) and bytes
/// that are not UTF-8 are written as \x1b. For whatever is quoted from a file.
std::string printable(std::string_view text);

/// How many mistakes apart two words are: letters put in, left out, replaced, or swapped with their neighbour
/// (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b);

}  // namespace cale
