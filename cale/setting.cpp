#include "cale/setting.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "cale/text.h"

namespace cale {
namespace {

/// 1_000 -> 1000 and +1 -> 1, which std::from_chars does not know.
std::string plain_number(std::string_view text) {
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    std::string result;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const bool separator =
            text[i] == '_' && i > 0 && i + 1 < text.size() && is_digit(text[i - 1]) && is_digit(text[i + 1]);
        const bool plus = i == 0 && text[i] == '+' && text.size() > 1 && text[1] != '-';
        if (!separator && !plus) result += text[i];
    }
    return result;
}

std::optional<double> parse_number(std::string_view text) {
    const auto value = number_in<double>(plain_number(text));
    return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<std::int64_t> parse_integer(std::string_view text) {
    if (const auto value = number_in<std::int64_t>(plain_number(text))) return value;
    // 1e6, 2.5e3: exact as long as a double can count.
    const auto value = parse_number(text);
    if (!value || *value != std::trunc(*value) || std::abs(*value) > 0x1p53) return std::nullopt;
    return static_cast<std::int64_t>(*value);
}

/// The integers of "4" or "0-8"; none if the text is neither, or the first is the larger.
std::optional<IntegerRange> parse_integer_range(std::string_view text) {
    const auto dash = text.find('-', 1);  // a sign comes first
    const auto low = number_in<std::int64_t>(text.substr(0, dash));
    const auto high = dash == text.npos ? low : number_in<std::int64_t>(text.substr(dash + 1));
    if (!low || !high || *low > *high) return std::nullopt;
    return IntegerRange{*low, *high};
}

/// Whether it is one, however large.
bool is_whole_number(std::string_view text) {
    const auto number = plain_number(text);
    const auto digits = std::string_view(number).substr(number.starts_with('-') ? 1 : 0);
    if (!digits.empty() && digits.find_first_not_of("0123456789") == digits.npos) return true;
    const auto value = parse_number(text);
    return value && *value == std::trunc(*value);
}

template <class... Format>
std::string number_text(double value, Format... format) {
    std::array<char, 32> text;
    return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value, format...).ptr};
}

/// The fewest digits that are read back as the same number, with an exponent below 1e-4 and from 1e16 on.
std::string exact_number(double value) {
    auto text = number_text(value, std::chars_format::scientific);
    const auto exponent = text.find('e');
    if (exponent == text.npos) return text;  // inf, nan
    const auto power = number_in<int>(plain_number(std::string_view(text).substr(exponent + 1)));
    return *power >= -4 && *power < 16 ? number_text(value, std::chars_format::fixed) : text;
}

/// 1000000000000 -> 1e12, where nothing is lost.
std::string short_number(double value) {
    const bool whole = value == std::trunc(value) && std::abs(value) <= 0x1p53;
    auto exact = whole ? std::to_string(static_cast<std::int64_t>(value)) : number_text(value);
    if (std::abs(value) < 1e6) return exact;
    const auto rounded = number_text(value, std::chars_format::scientific, 0);  // 1e+12, 1e+09
    const auto digits = rounded.find_first_not_of("+0", rounded.find('e') + 1);
    const auto text = rounded.substr(0, rounded.find('e') + 1) + rounded.substr(digits);
    return parse_number(text) == value ? text : exact;
}

std::string joined(std::span<const std::string_view> words) {
    std::string text;
    for (const auto word : words) text.append(text.empty() ? "" : ", ").append(word);
    return text;
}

struct TypeName {
    std::string operator()(const std::int64_t*) const { return "integer"; }
    std::string operator()(const double*) const { return "number"; }
    std::string operator()(const std::optional<double>*) const { return "number or none"; }
    std::string operator()(const std::optional<std::int64_t>*) const { return "integer or none"; }
    std::string operator()(const IntegerRange*) const { return "integer, or two such as 0-8"; }
    std::string operator()(const bool*) const { return "true/false"; }
    std::string operator()(const std::string*) const { return "text"; }
    std::string operator()(const EnumMember& member) const { return "one of " + joined(member.names); }
};

struct Writer {
    std::string operator()(const std::int64_t* member) const { return std::to_string(*member); }
    std::string operator()(const double* member) const { return exact_number(*member); }
    template <class Number>
    std::string operator()(const std::optional<Number>* member) const {
        return *member ? (*this)(&**member) : "none";
    }
    std::string operator()(const IntegerRange* member) const {
        const auto low = std::to_string(member->low);
        return member->low == member->high ? low : low + '-' + std::to_string(member->high);
    }
    std::string operator()(const bool* member) const { return *member ? "true" : "false"; }
    std::string operator()(const std::string* member) const { return *member; }
    std::string operator()(const EnumMember& member) const { return std::string(member.names[member.get()]); }
};

/// Reads text into a member of each type.
struct Reader {
    std::string_view key;
    Range range;
    std::string_view text;

    [[noreturn]] void reject(const std::string& what, const std::string& hint = "") const {
        throw std::invalid_argument(std::string(key) + " must be " + what + ", not '" + std::string(text) +
                                    "'" + hint);
    }
    /// Of integers, which all fit into 64 bits.
    std::string range_of_integers() const {
        constexpr auto kLimits = std::numeric_limits<std::int64_t>();
        const auto own = range_text(range);
        return own.empty() ? std::to_string(kLimits.min()) + " to " + std::to_string(kLimits.max()) : own;
    }
    template <class Number>
    Number checked(std::optional<Number> value, const std::string& what) const {
        if (!value) reject(what);
        const auto number = static_cast<double>(*value);
        if (number < range.low || number > range.high) reject(range_text(range));
        return *value;
    }

    void operator()(std::int64_t* member) const {
        const auto value = parse_integer(text);
        if (!value && is_whole_number(text)) reject(range_of_integers());
        *member = checked(value, "an integer");
    }
    void operator()(double* member) const { *member = checked(parse_number(text), "a number"); }
    void operator()(std::optional<double>* member) const {
        read_optional(member, parse_number, "a number or none");
    }
    void operator()(std::optional<std::int64_t>* member) const {
        read_optional(member, parse_integer, "an integer or none");
    }
    template <class Number>
    void read_optional(std::optional<Number>* member, std::optional<Number> (*parse)(std::string_view),
                       const std::string& what) const {
        if (means_none(text)) {
            member->reset();
        } else {
            *member = checked(parse(text), what);
        }
    }
    void operator()(IntegerRange* member) const {
        const auto value = parse_integer_range(text);
        if (!value) reject("an integer, or two such as 0-8");
        checked(std::optional(value->low), "an integer");
        checked(std::optional(value->high), "an integer");
        *member = *value;
    }
    void operator()(bool* member) const {
        const auto value = truth_in(text);
        if (!value) reject("true or false");
        *member = *value;
    }
    void operator()(std::string* member) const { *member = text; }
    void operator()(const EnumMember& member) const {
        const auto found = std::ranges::find(member.names, text);
        if (found == member.names.end()) {
            const std::vector<std::string> names(member.names.begin(), member.names.end());
            reject(TypeName{}(member), did_you_mean(text, names));
        }
        member.set(static_cast<std::size_t>(found - member.names.begin()));
    }
};

}  // namespace

std::string setting_type(const SettingMember& member) {
    return std::visit(TypeName{}, member);
}

std::string range_text(Range range) {
    const bool low = std::isfinite(range.low);
    const bool high = std::isfinite(range.high);
    if (low && high) return short_number(range.low) + " to " + short_number(range.high);
    if (low) return "at least " + short_number(range.low);
    if (high) return "at most " + short_number(range.high);
    return "";
}

void read_setting(std::string_view key, Range range, std::string_view text, const SettingMember& member) {
    std::visit(Reader{key, range, text}, member);
}

std::string written_setting(const SettingMember& member) {
    return std::visit(Writer{}, member);
}

std::optional<bool> truth_in(std::string_view text) {
    const auto word = lower(text);
    if (word == "true" || word == "yes" || word == "on") return true;
    if (word == "false" || word == "no" || word == "off") return false;
    return std::nullopt;
}

bool means_none(std::string_view text) {
    const auto word = lower(text);
    return word == "none" || word == "null" || word == "~";
}

}  // namespace cale
