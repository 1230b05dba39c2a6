#include "experiment/console.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "cale/text.h"

namespace cale {
namespace {

constexpr auto kDrawInterval = std::chrono::milliseconds(200);
constexpr int kUsualWidth = 100;
constexpr int kNarrowestBar = 10;
constexpr int kWidestBar = 40;

/// 950, 12.3k, 200M: three digits are enough for a bar.
std::string short_count(std::int64_t count) {
    auto value = static_cast<double>(count);
    const char* unit = "";
    for (const char* next : {"k", "M", "G"}) {
        if (value < 999.5) break;
        value /= 1000;
        unit = next;
    }
    const int decimals = *unit == '\0' || value >= 99.95 ? 0 : 1;
    auto text = fmt::format("{:.{}f}", value, decimals);
    if (text.ends_with(".0")) text.resize(text.size() - 2);
    return text + unit;
}

double seconds_left(const Progress& progress) {
    return static_cast<double>(progress.total_steps - progress.step) / progress.steps_per_second;
}

std::string mean_return_text(const Progress& progress) {
    return progress.mean_return ? fmt::format("{:.1f}", *progress.mean_return) : "-";
}

}  // namespace

std::string duration_text(double seconds) {
    if (!std::isfinite(seconds) || seconds < 0) return "-";
    const auto whole = static_cast<std::int64_t>(std::llround(seconds));
    const auto days = whole / 86'400, hours = whole / 3600 % 24, minutes = whole / 60 % 60;
    if (days > 0) return fmt::format("{}d {:02}:{:02}", days, hours, minutes);
    if (hours > 0) return fmt::format("{}:{:02}:{:02}", hours, minutes, whole % 60);
    return fmt::format("{}:{:02}", minutes, whole % 60);
}

std::string progress_bar(const Progress& progress, int width) {
    const double done =
        progress.total_steps > 0
            ? std::clamp(static_cast<double>(progress.step) / static_cast<double>(progress.total_steps), 0.0,
                         1.0)
            : 1.0;
    const std::string percentage = fmt::format("{:3.0f}%", std::floor(100 * done));
    std::vector<std::string> texts = {
        fmt::format("{}/{} steps", short_count(progress.step), short_count(progress.total_steps)),
        fmt::format("{:.0f}/s", progress.steps_per_second),
        fmt::format("ETA {}", duration_text(seconds_left(progress))),
        fmt::format("return {}", mean_return_text(progress)),
        fmt::format("{} frames", short_count(progress.frame)),
    };
    for (const auto& [name, value] : progress.values) texts.push_back(fmt::format("{} {:.3g}", name, value));

    std::string tail;
    for (const auto& text : texts) {
        const auto columns =
            percentage.size() + std::size_t{3 + kNarrowestBar} + tail.size() + 2 + text.size();
        if (columns > static_cast<std::size_t>(std::max(width, 0))) break;
        tail += "  " + text;
    }
    const int room = width - static_cast<int>(percentage.size() + 3 + tail.size());
    if (room < 1) return percentage.substr(0, static_cast<std::size_t>(std::max(width, 0)));
    const int columns = std::min(room, kWidestBar);
    const auto full = static_cast<std::size_t>(std::floor(done * columns));
    return fmt::format("{} [{}{}]{}", percentage, std::string(full, '#'),
                       std::string(static_cast<std::size_t>(columns) - full, '.'), tail);
}

std::string progress_line(const Progress& progress) {
    auto line =
        fmt::format("step {}/{}  frames {}  {:.1f} steps/s  ETA {}  episodes {}  return {}", progress.step,
                    progress.total_steps, progress.frame, progress.steps_per_second,
                    duration_text(seconds_left(progress)), progress.episodes, mean_return_text(progress));
    for (const auto& [name, value] : progress.values) {
        fmt::format_to(std::back_inserter(line), "  {} {:.4g}", name, value);
    }
    return line;
}

Console::Console(std::FILE* out, bool progress_bar)
    : out_(out), bar_(progress_bar && ::isatty(::fileno(out)) == 1) {}

void Console::header(std::string_view title, std::span<const std::pair<std::string, std::string>> facts) {
    std::size_t widest = 0;
    for (const auto& [label, value] : facts) widest = std::max(widest, label.size());
    fmt::print(out_, "{}\n", title);
    for (const auto& [label, value] : facts)
        fmt::print(out_, "  {:<{}}  {}\n", label, widest, printable(value));
    fmt::print(out_, "\n");
    std::fflush(out_);
}

bool Console::due() const {
    return bar_ && std::chrono::steady_clock::now() >= next_draw_;
}

void Console::draw(const Progress& progress) {
    if (!bar_) return;
    // The last column stays free: some terminals wrap a line that fills it. \033[K clears what an
    // earlier, longer line left.
    fmt::print(out_, "\r{}\033[K", cale::progress_bar(progress, width() - 1));
    std::fflush(out_);
    drawn_ = true;
    next_draw_ = std::chrono::steady_clock::now() + kDrawInterval;
}

void Console::report(const Progress& progress) {
    if (bar_) return draw(progress);
    fmt::print(out_, "{}\n", progress_line(progress));
    std::fflush(out_);
}

void Console::message(std::string_view text) {
    fmt::print(out_, "{}{}\n", drawn_ ? "\r\033[K" : "", printable(text));
    std::fflush(out_);
    drawn_ = false;
    next_draw_ = {};
}

void Console::finish(const Progress& progress, std::string_view text) {
    report(progress);
    fmt::print(out_, "{}{}\n", drawn_ ? "\n" : "", text);
    std::fflush(out_);
    drawn_ = false;
}

int Console::width() const {
    winsize size{};
    if (::ioctl(::fileno(out_), TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return kUsualWidth;
    return size.ws_col;
}

}  // namespace cale
