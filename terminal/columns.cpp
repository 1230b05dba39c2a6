#include "terminal/columns.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>

#include <fmt/format.h>

namespace cale {

std::string wrap(std::string_view text, std::size_t indent, std::size_t width) {
    const std::string margin(indent, ' ');
    std::string result;
    std::string line;
    while (!text.empty()) {
        const auto space = std::min(text.find(' '), text.size());
        const auto word = text.substr(0, space);
        text.remove_prefix(std::min(space + 1, text.size()));
        if (!line.empty() && indent + line.size() + 1 + word.size() > width) {
            result += margin + line + '\n';
            line.clear();
        }
        if (!line.empty()) line += ' ';
        line += word;
    }
    return line.empty() ? result : result + margin + line + '\n';
}

std::string two_columns(std::string_view left, std::string_view right, std::size_t column,
                        std::size_t width) {
    const auto text = wrap(right, column, width);
    const auto name = fmt::format("  {}", left);
    if (name.size() + 2 > column || text.empty()) return name + '\n' + text;
    return name + text.substr(name.size());
}

std::size_t terminal_width() {
    winsize size{};
    if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
    return std::clamp<std::size_t>(size.ws_col, 40, 120);
}

}  // namespace cale
