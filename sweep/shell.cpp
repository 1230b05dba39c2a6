#include "sweep/shell.h"

#include <array>
#include <cstdio>
#include <stdexcept>

#include <fmt/format.h>

namespace cale {
namespace {

/// Whether a shell reads it as it stands.
bool is_plain(const std::string& text) {
    return !text.empty() && text.find_first_not_of(
                                "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                "0123456789_-./=:,+@%") == std::string::npos;
}

}  // namespace

std::string shell_text(std::span<const std::string> arguments) {
    std::string text;
    for (const auto& argument : arguments) {
        if (!text.empty()) text += ' ';
        if (is_plain(argument)) {
            text += argument;
            continue;
        }
        text += '\'';
        for (const char c : argument) {
            if (c == '\'') {
                text += "'\\''";
            } else {
                text += c;
            }
        }
        text += '\'';
    }
    return text;
}

Answer answer_of(const std::string& command) {
    std::FILE* pipe = ::popen(command.c_str(), "r");
    if (pipe == nullptr) throw std::runtime_error(fmt::format("cannot start '{}'", command));
    Answer answer;
    std::array<char, 4096> bytes{};
    while (const auto count = std::fread(bytes.data(), 1, bytes.size(), pipe))
        answer.text.append(bytes.data(), count);
    answer.status = ::pclose(pipe);
    return answer;
}

std::string without_line_end(std::string text) {
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
    return text;
}

}  // namespace cale
