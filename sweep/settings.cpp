#include "sweep/settings.h"

#include <optional>
#include <stdexcept>

#include "cale/setting.h"
#include "settings/config.h"

namespace cale {
namespace {

/// The Value that a training program reads from the text; none where it reads no Value.
template <class Value>
std::optional<Value> read_as(const std::string& text) {
    Value value{};
    try {
        read_setting("", {}, text, &value);
    } catch (const std::invalid_argument&) {
        return std::nullopt;
    }
    return value;
}

/// What it prints of that.
template <class Value>
std::optional<std::string> printed_as(const std::string& text) {
    auto value = read_as<Value>(text);
    return value ? std::optional(written_setting(&*value)) : std::nullopt;
}

}  // namespace

std::string printed_value(const std::string& text) {
    if (auto truth = printed_as<bool>(text)) return *truth;
    if (auto number = printed_as<std::int64_t>(text)) return *number;
    if (auto number = printed_as<std::optional<double>>(text)) return *number;
    return printed_as<IntegerRange>(text).value_or(text);
}

bool same_value(const std::string& a, const std::string& b) {
    return a == b || printed_value(a) == printed_value(b);
}

std::int64_t integer_in(const std::string& text) {
    std::int64_t value = 0;
    try {
        read_setting("a number of steps", {}, text, &value);
    } catch (const std::invalid_argument& error) {
        throw ConfigError(error.what());
    }
    return value;
}

std::optional<std::int64_t> if_integer(const std::string& text) {
    return read_as<std::int64_t>(text);
}

}  // namespace cale
