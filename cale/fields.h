// How a configuration struct describes its members to the rest of the program: by a function beside it,
//
//     template <class Visit>
//     void fields(SacConfig& config, Visit&& visit) {
//         visit("gamma", config.gamma, Range{0, 1}, "discount per agent step");
//         visit("exploration", config.exploration, "how actions are explored");
//     }
// That one table serves the YAML reader, --set, --help, --print-config, the record of a run and the
// documentation. `visit` accepts
//   std::int64_t, double, either one optional, IntegerRange   name, member, Range, sentence
//   bool, std::string, an enumeration                         name, member, sentence
// An enumeration E is readable when `names_of(E)` returns its values' names in order.
#pragma once

#include <cstddef>
#include <limits>
#include <string_view>
#include <type_traits>

namespace cale {

/// The closed interval that a number must lie in.
struct Range {
    double low = -std::numeric_limits<double>::infinity();  // smallest value that is allowed
    double high = std::numeric_limits<double>::infinity();  // largest
};

/// Returns the name of an enumeration's value.
template <class Enum>
requires std::is_enum_v<Enum> std::string_view name_of(Enum value) {
    return names_of(value)[static_cast<std::size_t>(value)];
}

}  // namespace cale
