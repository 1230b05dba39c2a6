#include "sweep/shell.h"

#include <array>
#include <cstdio>
#include <stdexcept>

#include <fmt/format.h>

namespace cale {

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
