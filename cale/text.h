// What reading names and tables needs of text.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace cale {

/// The parts between the separators: one more than there are separators, of which any may be empty.
std::vector<std::string> split(std::string_view text, char separator);

/// How many mistakes apart two words are: letters put in, left out, replaced, or swapped with their neighbour
/// (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b);

}  // namespace cale
