#include "policy/json.h"

#include <algorithm>
#include <charconv>
#include <set>

#include "cale/text.h"

namespace cale {
namespace {

constexpr int kMaxDepth = 4;
constexpr std::size_t kMaxValues = 100'000;  // of an object or an array
constexpr std::size_t kLongestQuotation = 100;

void append_utf8(std::string& text, std::uint32_t code) {
    const auto put = [&](std::uint32_t byte) { text += static_cast<char>(byte); };
    if (code < 0x80) {
        put(code);
    } else if (code < 0x800) {
        put(0xc0 | code >> 6);
        put(0x80 | (code & 0x3f));
    } else if (code < 0x10000) {
        put(0xe0 | code >> 12);
        put(0x80 | (code >> 6 & 0x3f));
        put(0x80 | (code & 0x3f));
    } else {
        put(0xf0 | code >> 18);
        put(0x80 | (code >> 12 & 0x3f));
        put(0x80 | (code >> 6 & 0x3f));
        put(0x80 | (code & 0x3f));
    }
}

[[noreturn]] void invalid() {
    throw FileDamage("its header is not valid JSON");
}

void require_few(std::size_t count) {
    if (count > kMaxValues) throw FileDamage("its header has more than 100,000 values in a row");
}

/// Walks through a text. Everything it passes is checked.
class Reader {
  public:
    explicit Reader(std::string_view text) : text_(text) {}

    void skip_space() {
        while (at_ < text_.size() && std::string_view(" \t\n\r").find(text_[at_]) != text_.npos) ++at_;
    }
    bool done() const { return at_ == text_.size(); }
    bool next_is(char c) const { return !done() && text_[at_] == c; }
    bool accept(char c) {
        if (!next_is(c)) return false;
        ++at_;
        return true;
    }
    void expect(char c) {
        if (!accept(c)) invalid();
    }

    /// A value; its text without the space around it.
    std::string_view value(int depth) {
        const auto begin = at_;
        if (next_is('{') || next_is('[')) {
            if (depth > kMaxDepth) throw FileDamage("its header is nested too deeply");
            if (next_is('{')) {
                object(depth, [](const std::string&, std::string_view) {});
            } else {
                array(depth, [](std::string_view) {});
            }
        } else if (next_is('"')) {
            string();
        } else if (!accept_word("true") && !accept_word("false") && !accept_word("null")) {
            number();
        }
        return text_.substr(begin, at_ - begin);
    }

    /// Calls member(name, value) for each.
    template <class Member>
    void object(int depth, Member&& member) {
        std::set<std::string> names;
        expect('{');
        skip_space();
        if (accept('}')) return;
        do {
            skip_space();
            auto name = string();
            if (!names.insert(name).second) throw FileDamage({"its header has ", in_quotes(name), " twice"});
            require_few(names.size());
            skip_space();
            expect(':');
            skip_space();
            const auto text = value(depth + 1);
            member(std::move(name), text);
            skip_space();
        } while (accept(','));
        expect('}');
    }

    template <class Element>
    void array(int depth, Element&& element) {
        std::size_t count = 0;
        expect('[');
        skip_space();
        if (accept(']')) return;
        do {
            require_few(++count);
            skip_space();
            element(value(depth + 1));
            skip_space();
        } while (accept(','));
        expect(']');
    }

    std::string string() {
        expect('"');
        std::string result;
        while (!accept('"')) {
            if (done() || static_cast<unsigned char>(text_[at_]) < 0x20) invalid();
            if (accept('\\')) {
                escape(result);
                continue;
            }
            const auto length = utf8_length(text_.substr(at_));
            if (length == 0) invalid();
            result += text_.substr(at_, length);
            at_ += length;
        }
        return result;
    }

  private:
    bool accept_word(std::string_view word) {
        if (!text_.substr(at_).starts_with(word)) return false;
        at_ += word.size();
        return true;
    }

    std::uint32_t hexadecimal() {
        std::uint32_t code = 0;
        const auto digits = text_.substr(at_, 4);
        const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), code, 16);
        if (error != std::errc() || end != digits.data() + 4) invalid();
        at_ += 4;
        return code;
    }

    void escape(std::string& result) {
        constexpr std::string_view letters = "\"\\/bfnrt";
        constexpr std::string_view meanings = "\"\\/\b\f\n\r\t";
        if (done()) invalid();
        const char letter = text_[at_++];
        if (letter != 'u') {
            const auto found = letters.find(letter);
            if (found == letters.npos) invalid();
            result += meanings[found];
            return;
        }
        auto code = hexadecimal();
        if (code >= 0xd800 && code < 0xdc00) {  // the first half of a pair
            if (!accept_word("\\u")) invalid();
            const auto second = hexadecimal();
            if (second < 0xdc00 || second > 0xdfff) invalid();
            code = 0x10000 + ((code - 0xd800) << 10) + (second - 0xdc00);
        } else if (code >= 0xdc00 && code < 0xe000) {
            invalid();
        }
        append_utf8(result, code);
    }

    void digits() {
        const auto begin = at_;
        while (!done() && text_[at_] >= '0' && text_[at_] <= '9') ++at_;
        if (at_ == begin) invalid();
    }
    void number() {
        accept('-');
        if (!accept('0')) digits();
        if (accept('.')) digits();
        if (accept('e') || accept('E')) {
            if (!accept('+')) accept('-');
            digits();
        }
    }

    std::string_view text_;
    std::size_t at_ = 0;
};

}  // namespace

std::string concatenated(std::initializer_list<std::string_view> parts) {
    std::string text;
    for (const auto part : parts) text += part;
    return text;
}

void check_json(std::string_view text) {
    Reader reader(text);
    reader.skip_space();
    reader.value(1);
    reader.skip_space();
    if (!reader.done()) invalid();
}

std::optional<std::vector<std::pair<std::string, std::string_view>>> json_members(std::string_view value) {
    Reader reader(value);
    if (!reader.next_is('{')) return std::nullopt;
    std::vector<std::pair<std::string, std::string_view>> members;
    reader.object(
        1, [&](std::string name, std::string_view text) { members.emplace_back(std::move(name), text); });
    return members;
}

std::optional<std::vector<std::string_view>> json_elements(std::string_view value) {
    Reader reader(value);
    if (!reader.next_is('[')) return std::nullopt;
    std::vector<std::string_view> elements;
    reader.array(1, [&](std::string_view text) { elements.push_back(text); });
    return elements;
}

std::optional<std::string> json_text(std::string_view value) {
    Reader reader(value);
    if (!reader.next_is('"')) return std::nullopt;
    return reader.string();
}

std::optional<std::uint64_t> json_natural(std::string_view value) {
    return number_in<std::uint64_t>(value);
}

std::string to_json(std::string_view text) {
    constexpr std::string_view hexadecimals = "0123456789abcdef";
    constexpr std::string_view meanings = "\"\\\b\f\n\r\t";
    constexpr std::string_view letters = "\"\\bfnrt";
    std::string result = "\"";
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        if (const auto found = meanings.find(c); found != meanings.npos) {
            result += '\\';
            result += letters[found];
        } else if (byte < 0x20) {
            result += "\\u00";
            result += hexadecimals[byte >> 4];
            result += hexadecimals[byte & 15];
        } else {
            result += c;
        }
    }
    return result + '"';
}

bool is_utf8(std::string_view text) {
    while (!text.empty()) {
        const auto length = utf8_length(text);
        if (length == 0) return false;
        text.remove_prefix(length);
    }
    return true;
}

std::string in_quotes(std::string_view text) {
    const bool is_long = text.size() > kLongestQuotation;
    auto length = std::min(text.size(), kLongestQuotation);
    for (int i = 0; is_long && i < 3 && continues_character(text[length]); ++i)
        --length;  // no character of UTF-8 is cut
    auto result = printable(to_json(text.substr(0, length)));
    result.front() = '\'';
    result.pop_back();
    return result + (is_long ? "...'" : "'");
}

}  // namespace cale
