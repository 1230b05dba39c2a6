#include "cale/text.h"

#include <algorithm>
#include <charconv>
#include <numeric>
#include <utility>

namespace cale {

std::vector<std::string> split(std::string_view text, char separator) {
    std::vector<std::string> parts;
    for (auto at = text.find(separator); at != text.npos; at = text.find(separator)) {
        parts.emplace_back(text.substr(0, at));
        text.remove_prefix(at + 1);
    }
    parts.emplace_back(text);
    return parts;
}

std::size_t utf8_length(std::string_view text) {
    const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
    const auto first = byte(0);
    if (first < 0x80) return 1;
    const std::size_t size = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
    if (first < 0xc2 || first > 0xf4 || text.size() < size) return 0;
    for (std::size_t i = 1; i < size; ++i)
        if (byte(i) < 0x80 || byte(i) > 0xbf) return 0;
    const bool overlong = (first == 0xe0 && byte(1) < 0xa0) || (first == 0xf0 && byte(1) < 0x90);
    const bool surrogate = first == 0xed && byte(1) > 0x9f;
    const bool too_large = first == 0xf4 && byte(1) > 0x8f;
    return overlong || surrogate || too_large ? 0 : size;
}

namespace {

bool is_control(std::string_view character) {
    const auto byte = static_cast<unsigned char>(character.back());
    if (character.size() == 1) return byte < 0x20 || byte == 0x7f;
    return character.size() == 2 && character.front() == '\xc2' && byte < 0xa0;  // C1
}

}  // namespace

std::string printable(std::string_view text) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    std::string line;
    while (!text.empty()) {
        const auto size = utf8_length(text);
        const auto character = text.substr(0, std::max<std::size_t>(size, 1));
        if (size > 0 && !is_control(character)) {
            line += character;
        } else {
            for (const char c : character) {
                const auto byte = static_cast<unsigned char>(c);
                line += {'\\', 'x', kDigits[byte >> 4], kDigits[byte & 15]};
            }
        }
        text.remove_prefix(character.size());
    }
    return line;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> before(b.size() + 1);  // row i - 1
    std::vector<std::size_t> row(b.size() + 1);     // row i
    std::vector<std::size_t> next(b.size() + 1);    // row i + 1
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        next[0] = i + 1;
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t replaced = row[j] + (a[i] == b[j] ? 0 : 1);
            next[j + 1] = std::min({replaced, next[j] + 1, row[j + 1] + 1});
            if (i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j]) {
                next[j + 1] = std::min(next[j + 1], before[j - 1] + 1);
            }
        }
        std::swap(before, row);
        std::swap(row, next);
    }
    return row.back();
}

bool natural_less(std::string_view a, std::string_view b) {
    const auto is_digit = [](std::string_view text) { return text.front() >= '0' && text.front() <= '9'; };
    auto rest_a = a, rest_b = b;
    while (!rest_a.empty() && !rest_b.empty()) {
        double left = static_cast<unsigned char>(rest_a.front()),
               right = static_cast<unsigned char>(rest_b.front());
        std::size_t taken_a = 1, taken_b = 1;
        if (is_digit(rest_a) && is_digit(rest_b)) {
            const auto number = [](std::string_view text, double& value) {
                const auto end = std::from_chars(text.data(), text.data() + text.size(), value).ptr;
                return static_cast<std::size_t>(end - text.data());
            };
            taken_a = number(rest_a, left);
            taken_b = number(rest_b, right);
        }
        if (left != right) return left < right;
        rest_a.remove_prefix(taken_a);
        rest_b.remove_prefix(taken_b);
    }
    if (rest_a.empty() != rest_b.empty()) return rest_a.empty();
    return a < b;
}

std::string lower(std::string_view text) {
    std::string result(text);
    for (char& c : result) {
        if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    }
    return result;
}

std::string nearest(std::string_view text, std::span<const std::string> candidates) {
    std::string best;
    // A third of the letters may be wrong, and one always.
    std::size_t limit = std::max<std::size_t>(1, text.size() / 3) + 1;
    for (const auto& candidate : candidates) {
        const auto distance = edit_distance(lower(text), lower(candidate));
        // Nothing in common is no misspelling, however short.
        if (distance < limit && distance < std::max(text.size(), candidate.size())) {
            limit = distance;
            best = candidate;
        }
    }
    return best;
}

std::string did_you_mean(std::string_view text, std::span<const std::string> candidates) {
    const auto guess = nearest(text, candidates);
    return guess.empty() ? "" : "; did you mean '" + guess + "'?";
}

}  // namespace cale
