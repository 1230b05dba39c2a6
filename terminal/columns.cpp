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

std::optional<TerminalSize> terminal_size(std::FILE* out) {
    winsize size{};
    if (::ioctl(::fileno(out), TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return std::nullopt;
    return TerminalSize{.columns = size.ws_col, .rows = size.ws_row};
}

std::size_t terminal_width() {
    const auto size = terminal_size(stdout);
    return size ? std::clamp<std::size_t>(size->columns, 40, 120) : 80;
}

}  // namespace cale
