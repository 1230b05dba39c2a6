// Values of settings as text: what a training program reads from them and prints.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace cale {

/// Returns the value as a training program prints it: 0.0001 for 1e-4, 600000 for 600_000, true for on.
std::string printed_value(const std::string& text);

/// Whether a training program reads the same value from both: 1e-4 and 0.0001, 600_000 and 600000, on and
/// true.
bool same_value(const std::string& a, const std::string& b);

/// As the training programs read an integer. Throws ConfigError.
std::int64_t integer_in(const std::string& text);
/// The same; none for another value, which an agent of one's own may have under a name that others use.
std::optional<std::int64_t> if_integer(const std::string& text);

}  // namespace cale
