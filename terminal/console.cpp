#include "terminal/console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "cale/text.h"
#include "terminal/columns.h"

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
    if (progress.step >= progress.total_steps) return 0;
    if (!progress.learns) return std::numeric_limits<double>::infinity();
    return static_cast<double>(progress.total_steps - progress.step) / progress.steps_per_second;
}

/// Until the games are played or the steps are taken, whichever comes first. Games under way are taken to
/// last as long as those that have ended; how long the last ones go on after the steps is not known.
double seconds_left(const GamesProgress& progress) {
    double left = std::numeric_limits<double>::infinity();
    const auto steps = static_cast<double>(progress.steps);
    if (progress.total_steps > progress.steps) left = static_cast<double>(progress.total_steps) - steps;
    if (progress.total_games > 0 && progress.games > 0)
        left = std::min(left, static_cast<double>(progress.total_games) * progress.mean_length - steps);
    if (progress.total_games > 0 && progress.games >= progress.total_games) left = 0;
    return left > 0 ? left / progress.steps_per_second : 0;
}

std::string mean_return_text(const std::optional<double>& mean) {
    return mean ? fmt::format("{:.1f}", *mean) : "-";
}

/// "12/100 games"; "12 games" if the total is unknown.
std::string games_text(const GamesProgress& progress) {
    if (progress.total_games > 0) return fmt::format("{}/{} games", progress.games, progress.total_games);
    return counted(progress.games, "game");
}

/// [0, 1]; 0 where `all` is not known.
double ratio(std::int64_t part, std::int64_t all) {
    return all > 0 ? std::clamp(static_cast<double>(part) / static_cast<double>(all), 0.0, 1.0) : 0.0;
}

/// " 50% [####....]" and as many of the texts as there is room for, the first ones first.
std::string bar(double done, const std::vector<std::string>& texts, int width) {
    const std::string percentage = fmt::format("{:3.0f}%", std::floor(100 * done));
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
    std::vector<std::string> texts = {
        fmt::format("{}/{} steps", short_count(progress.step), short_count(progress.total_steps)),
        fmt::format("{:.0f}/s", progress.steps_per_second),
        fmt::format("ETA {}", duration_text(seconds_left(progress))),
        fmt::format("return {}", mean_return_text(progress.mean_return)),
        fmt::format("{} frames", short_count(progress.frame)),
    };
    for (const auto& [name, value] : progress.values) texts.push_back(fmt::format("{} {:.3g}", name, value));
    const double done = progress.total_steps > 0 ? ratio(progress.step, progress.total_steps) : 1.0;
    return bar(done, texts, width);
}

std::string progress_bar(const GamesProgress& progress, int width) {
    std::vector<std::string> texts;
    if (!progress.title.empty()) texts.push_back(progress.title);
    texts.push_back(games_text(progress));
    texts.push_back(fmt::format("mean return {}", mean_return_text(progress.mean_return)));
    texts.push_back(fmt::format("ETA {}", duration_text(seconds_left(progress))));
    for (const auto& [name, value] : progress.values) texts.push_back(fmt::format("{} {:.3g}", name, value));
    texts.push_back(fmt::format("{} steps", short_count(progress.steps)));
    texts.push_back(fmt::format("{:.0f}/s", progress.steps_per_second));
    const double done =
        std::max(ratio(progress.games, progress.total_games), ratio(progress.steps, progress.total_steps));
    return bar(done, texts, width);
}

std::string progress_line(const Progress& progress) {
    auto line = fmt::format("step {}/{}  frames {}  {:.1f} steps/s  ETA {}  episodes {}  return {}",
                            progress.step, progress.total_steps, progress.frame, progress.steps_per_second,
                            duration_text(seconds_left(progress)), progress.episodes,
                            mean_return_text(progress.mean_return));
    for (const auto& [name, value] : progress.values) {
        fmt::format_to(std::back_inserter(line), "  {} {:.4g}", name, value);
    }
    return line;
}

std::string progress_line(const GamesProgress& progress) {
    std::string line = progress.title.empty() ? "" : progress.title + "  ";
    line += games_text(progress);
    for (const auto& [name, value] : progress.values)
        fmt::format_to(std::back_inserter(line), "  {} {:.6g}", name, value);
    return line + fmt::format("  mean return {}  {:.1f} steps/s  ETA {}",
                              mean_return_text(progress.mean_return), progress.steps_per_second,
                              duration_text(seconds_left(progress)));
}

Console::Console(std::FILE* out, bool progress_bar)
    : out_(out), bar_(progress_bar && ::isatty(::fileno(out)) == 1) {}

Console::~Console() {
    clear();
}

void Console::header(std::string_view title, std::span<const std::pair<std::string, std::string>> facts) {
    std::size_t widest = 0;
    for (const auto& [label, value] : facts) widest = std::max(widest, label.size());
    auto text = fmt::format("{}\n", title);
    for (const auto& [label, value] : facts)
        text += fmt::format("  {:<{}}  {}\n", label, widest, printable(value));
    write(text + "\n");
}

bool Console::due() const {
    return bar_ && std::chrono::steady_clock::now() >= next_draw_;
}

void Console::draw(const Progress& progress) {
    if (bar_) draw_line(progress_bar(progress, width() - 1));
}

void Console::draw(const GamesProgress& progress) {
    if (bar_) draw_line(progress_bar(progress, width() - 1));
}

void Console::report(const Progress& progress) {
    if (bar_) return draw(progress);
    write(progress_line(progress) + "\n");
}

void Console::report(const GamesProgress& progress) {
    if (bar_) return draw(progress);
    write(progress_line(progress) + "\n");
}

void Console::clear() {
    if (drawn_) write("\r\033[K");
    drawn_ = false;
    next_draw_ = {};
}

void Console::message(std::string_view text) {
    write(fmt::format("{}{}\n", drawn_ ? "\r\033[K" : "", printable(text)));
    drawn_ = false;
    next_draw_ = {};
}

void Console::finish(const Progress& progress, std::string_view text) {
    draw(progress);
    write(fmt::format("{}{}\n", drawn_ ? "\n" : "", text));
    drawn_ = false;
}

void Console::draw_line(const std::string& bar) {
    // The last column stays free: some terminals wrap a line that fills it. \033[K clears what an
    // earlier, longer line left.
    write(fmt::format("\r{}\033[K", bar));
    drawn_ = true;
    next_draw_ = std::chrono::steady_clock::now() + kDrawInterval;
}

void Console::write(std::string_view text) {
    std::fwrite(text.data(), 1, text.size(), out_);
    std::fflush(out_);
}

int Console::width() const {
    const auto size = terminal_size(out_);
    return size ? static_cast<int>(size->columns) : kUsualWidth;
}

}  // namespace cale
