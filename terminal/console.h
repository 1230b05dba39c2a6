// The terminal output of a run or an evaluation: a header, a progress bar or plain lines, and where the
// results are.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cale {

struct Progress {
    std::int64_t step = 0;  // agent steps
    std::int64_t total_steps = 0;
    std::int64_t frame = 0;  // emulated frames
    double steps_per_second = 0;
    bool learns = true;  // false: its speed is that without updates, and how long the rest takes is unknown
    std::int64_t episodes = 0;
    std::optional<double> mean_return{};  // of the newest 100 episodes; none before the first ends
    std::vector<std::pair<std::string, double>>
        values{};  // what else to show: {"alpha", 0.1}, {"epsilon", 0.01}
};

/// The progress of games without learning: an evaluation, or a film.
struct GamesProgress {
    std::string title{};           // what is shown first, if anything
    std::int64_t games = 0;        // that have ended
    std::int64_t total_games = 0;  // 0: not known before the end
    std::int64_t steps = 0;        // agent steps, of the games under way too
    std::int64_t total_steps = 0;  // 0: not known before the end
    double steps_per_second = 0;
    std::optional<double> mean_return{};                   // of the games that have ended
    double mean_length = 0;                                // agent steps, of the same
    std::vector<std::pair<std::string, double>> values{};  // what else to show
};

/// Seconds as "4:05", "1:02:03" or "12d 03:04"; "-" if they are not finite.
std::string duration_text(double seconds);

/// Returns one line for a terminal, at most `width` columns: if space is short, items are dropped from the
/// end; the bar fills the rest.
std::string progress_bar(const Progress& progress, int width);
std::string progress_bar(const GamesProgress& progress, int width);

/// One line for a log.
std::string progress_line(const Progress& progress);
std::string progress_line(const GamesProgress& progress);

/// Writes to a file that it does not own, which must outlive it. What cannot be written is lost: a terminal
/// that is closed ends no run.
class Console {
  public:
    /// Draws a bar if `out` is a terminal and `progress_bar` is true, else plain lines.
    explicit Console(std::FILE* out, bool progress_bar = true);
    /// Removes the bar: what is said of an error begins a line of its own.
    ~Console();
    Console(const Console&) = delete;
    Console& operator=(const Console&) = delete;

    /// A title, then one aligned line per label and value.
    void header(std::string_view title, std::span<const std::pair<std::string, std::string>> facts);

    /// Returns whether the bar must be redrawn: five times a second, never without a bar.
    bool due() const;
    /// Draws the bar, if there is one.
    void draw(const Progress& progress);
    void draw(const GamesProgress& progress);
    /// The report of every log interval: a line, or the bar drawn again.
    void report(const Progress& progress);
    void report(const GamesProgress& progress);
    /// Removes the bar, if there is one.
    void clear();

    /// A line of its own, above the bar.
    void message(std::string_view text);
    /// The end: the bar a last time, if there is one, and below it a line that says where the results are.
    void finish(const Progress& progress, std::string_view text);

  private:
    void draw_line(const std::string& bar);
    void write(std::string_view text);
    int width() const;

    std::FILE* out_;
    bool bar_;
    bool drawn_ = false;
    std::chrono::steady_clock::time_point next_draw_{};
};

}  // namespace cale
