// The subset of JSON (RFC 8259) that the headers of safetensors files need. Values stay text and lists are
// short, so that an untrusted header costs little more memory than its own size.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cale {

/// Returns the concatenated parts.
std::string concatenated(std::initializer_list<std::string_view> parts);

/// An error in a file, one sentence without the file's name.
struct FileDamage : std::runtime_error {
    explicit FileDamage(const std::string& sentence) : std::runtime_error(sentence) {}
    explicit FileDamage(std::initializer_list<std::string_view> parts) : FileDamage(concatenated(parts)) {}
};

/// Throws FileDamage that calls the text "its header" for anything but one JSON value in UTF-8 without names
/// that occur twice in an object, for more than four levels of nesting, and for an object or an array of more
/// than 100,000 values.
void check_json(std::string_view text);

// Parts of a text that passed check_json().

/// The members of an object in their order, name and value; none for another kind of value.
std::optional<std::vector<std::pair<std::string, std::string_view>>> json_members(std::string_view value);
/// The elements of an array.
std::optional<std::vector<std::string_view>> json_elements(std::string_view value);
/// Returns the contents of a string.
std::optional<std::string> json_text(std::string_view value);
/// A number without sign, fraction and exponent that fits.
std::optional<std::uint64_t> json_natural(std::string_view value);

/// `text`, which must be UTF-8, as a JSON string.
std::string to_json(std::string_view text);
/// Whether `text` is valid UTF-8.
bool is_utf8(std::string_view text);

/// Returns untrusted text for an error message: 'in quotes', control characters and what is no UTF-8 escaped,
/// long text truncated.
std::string in_quotes(std::string_view text);

}  // namespace cale
