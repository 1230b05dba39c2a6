#include "terminal/console.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <limits>
#include <string>

#include "support/terminal.h"

namespace cale {
namespace {

using test::Terminal;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

Progress halfway() {
    return {.step = 50'000,
            .total_steps = 100'000,
            .frame = 200'000,
            .steps_per_second = 500,
            .episodes = 66,
            .mean_return = -12.34,
            .values = {{"alpha", 0.01234}, {"epsilon", 0.1}}};
}

TEST(ProgressBar, ShowsEverythingWhereThereIsRoom) {
    EXPECT_EQ(progress_bar(halfway(), 140),
              " 50% [####################....................]  50k/100k steps  500/s  ETA 1:40  return "
              "-12.3  200k frames  alpha 0.0123  epsilon 0.1");
}

TEST(ProgressBar, NeverExceedsItsWidth) {
    std::size_t before = 0;
    for (int width = 0; width < 200; ++width) {
        const auto bar = progress_bar(halfway(), width);
        EXPECT_LE(bar.size(), static_cast<std::size_t>(width));
        EXPECT_GE(bar.size() + 25, before) << "at " << width;
        before = bar.size();
    }
}

TEST(ProgressBar, DropsTheLeastImportantFirst) {
    EXPECT_EQ(progress_bar(halfway(), 76),
              " 50% [###########...........]  50k/100k steps  500/s  ETA 1:40  return -12.3");
    EXPECT_EQ(progress_bar(halfway(), 36), " 50% [######.......]  50k/100k steps");
    EXPECT_EQ(progress_bar(halfway(), 12), " 50% [##...]");
}

TEST(ProgressBar, BeginsEmptyAndEndsFull) {
    Progress progress{.step = 0, .total_steps = 1'000'000};
    EXPECT_THAT(progress_bar(progress, 80), StartsWith("  0% [..."));
    EXPECT_THAT(progress_bar(progress, 80), HasSubstr("0/1M steps  0/s  ETA -  return -"));
    progress.steps_per_second = 1'000;
    EXPECT_THAT(progress_bar(progress, 80), HasSubstr("ETA 16:40"));
    progress.learns = false;
    EXPECT_THAT(progress_bar(progress, 80), HasSubstr("ETA -"));
    progress.step = 999'999;
    EXPECT_THAT(progress_bar(progress, 80), StartsWith(" 99%"));
    progress.step = 1'000'200;  // whole episodes may overshoot
    EXPECT_THAT(progress_bar(progress, 80), StartsWith("100% [###"));
    EXPECT_THAT(progress_bar(progress, 80), Not(HasSubstr("#.")));
}

TEST(ProgressLine, IsCompleteAndExact) {
    EXPECT_EQ(progress_line(halfway()),
              "step 50000/100000  frames 200000  500.0 steps/s  ETA 1:40  episodes 66  return -12.3  alpha "
              "0.01234  epsilon 0.1");
    Progress end = halfway();
    end.step = end.total_steps;
    EXPECT_THAT(progress_line(end), HasSubstr("500.0 steps/s  ETA 0:00  episodes"));
}

GamesProgress some_games() {
    return {.title = "run 2/8",
            .games = 25,
            .total_games = 100,
            .steps = 6000,
            .steps_per_second = 200,
            .mean_return = 12.34,
            .mean_length = 220};
}

TEST(ProgressOfGames, ShowsHowManyHaveEndedTheirMeanAndTheTimeLeft) {
    // 100 games of 220 steps are 22,000, of which 16,000 are left.
    EXPECT_EQ(progress_bar(some_games(), 140),
              " 25% [##########..............................]  run 2/8  25/100 games  mean return 12.3  ETA "
              "1:20  6k steps  200/s");
    EXPECT_THAT(progress_bar(some_games(), 60), HasSubstr("]  run 2/8  25/100 games  mean return 12.3"));
    auto one = some_games();
    one.values = {{"return", 7}};
    EXPECT_EQ(progress_line(one),
              "run 2/8  25/100 games  return 7  mean return 12.3  200.0 steps/s  ETA 1:20");
    one.games = 100;
    EXPECT_THAT(progress_line(one), HasSubstr("ETA 0:00"));
}

TEST(ProgressOfGames, MayBeOfStepsInstead) {
    GamesProgress progress{.games = 1,
                           .steps = 31'250,
                           .total_steps = 125'000,
                           .steps_per_second = 500,
                           .mean_return = 2,
                           .mean_length = 1000};
    EXPECT_THAT(progress_bar(progress, 140), StartsWith(" 25% ["));
    EXPECT_THAT(progress_bar(progress, 140), HasSubstr("1 game  mean return 2.0  ETA 3:08"));
    progress.steps = 125'000;  // those under way are played to their ends
    EXPECT_THAT(progress_bar(progress, 140), HasSubstr("ETA -"));
    progress.steps = 31'250;
    progress.total_games = 4;  // games of 1,000 steps: these are played first, or would be
    EXPECT_THAT(progress_bar(progress, 140), HasSubstr("1/4 games  mean return 2.0  ETA 0:00"));
    EXPECT_THAT(progress_bar({.total_games = 1, .steps = 10, .steps_per_second = 5}, 140),
                HasSubstr("0/1 games  mean return -  ETA -  10 steps  5/s"));
}

TEST(Duration, IsReadable) {
    EXPECT_EQ(duration_text(5.4), "0:05");
    EXPECT_EQ(duration_text(3599.6), "1:00:00");
    EXPECT_EQ(duration_text(86'400 * 12 + 3600 * 3 + 60 * 4 + 5), "12d 03:04");
    EXPECT_EQ(duration_text(std::numeric_limits<double>::infinity()), "-");
    EXPECT_EQ(duration_text(-1), "-");
}

/// Runs `action` on a console that writes to a file, and returns the file's text.
template <class Action>
std::string written(Action&& action) {
    std::FILE* file = std::tmpfile();
    action(file);
    std::rewind(file);
    std::string text;
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) text.push_back(static_cast<char>(c));
    std::fclose(file);
    return text;
}

TEST(ConsoleWithoutTerminal, WritesPlainLines) {
    const auto text = written([](std::FILE* file) {
        Console console(file);
        const std::pair<std::string, std::string> facts[] = {{"game", "ALE/Pong-v5"},
                                                             {"run folder", "runs/pong"}};
        console.header("cale 0.1.0: SAC", facts);
        EXPECT_FALSE(console.due());
        console.draw(halfway());
        console.report(halfway());
        console.message("a warning");
        console.finish(halfway(), "Results are in runs/pong");
    });
    EXPECT_EQ(text,
              "cale 0.1.0: SAC\n"
              "  game        ALE/Pong-v5\n"
              "  run folder  runs/pong\n"
              "\n" +
                  progress_line(halfway()) + "\na warning\nResults are in runs/pong\n");
}

TEST(ConsoleWithoutTerminal, LosesWhatCannotBeWritten) {
    std::FILE* full = std::fopen("/dev/full", "w");
    std::setvbuf(full, nullptr, _IONBF, 0);  // as the standard error
    Console console(full);
    console.header("cale 0.1.0: SAC", {});
    console.report(halfway());
    console.message("a warning");
    console.finish(halfway(), "Results are in runs/pong");
    EXPECT_NE(std::ferror(full), 0);
    std::fclose(full);
}

TEST(ConsoleOnATerminal, DrawsABarOfTheTerminalsWidth) {
    Terminal terminal(60);
    Console console(terminal.file());
    EXPECT_TRUE(console.due());
    const auto start = std::chrono::steady_clock::now();
    console.draw(halfway());
    const bool due = console.due();
    const auto taken = std::chrono::steady_clock::now() - start;
    EXPECT_FALSE(due && taken < std::chrono::milliseconds(200)) << "five times a second is enough";
    EXPECT_EQ(terminal.shown(), std::string("\r").append(progress_bar(halfway(), 59)).append("\033[K"));
}

TEST(ConsoleOnATerminal, DrawsTheBarOfGamesAndClearsIt) {
    Terminal terminal(70);
    Console console(terminal.file());
    console.report(some_games());
    EXPECT_EQ(terminal.shown(), std::string("\r").append(progress_bar(some_games(), 69)).append("\033[K"));
    console.clear();
    EXPECT_EQ(terminal.shown(), "\r\033[K");
    console.clear();
    EXPECT_EQ(terminal.shown(), "");
}

TEST(ConsoleOnATerminal, KeepsMessagesApartFromTheBar) {
    Terminal terminal(60);
    Console console(terminal.file());
    console.draw(halfway());
    console.message("a warning");
    EXPECT_THAT(terminal.shown(), EndsWith("\r\033[Ka warning\r\n"));
    EXPECT_TRUE(console.due()) << "the bar was wiped";
    console.finish(halfway(), "Results are in runs/pong");
    EXPECT_THAT(terminal.shown(), EndsWith("\033[K\r\nResults are in runs/pong\r\n"));
}

TEST(ConsoleOnATerminal, DrawsNoBarWhereNoneIsWanted) {
    Terminal terminal(60);
    Console console(terminal.file(), false);
    EXPECT_FALSE(console.due());
    console.report(halfway());
    EXPECT_EQ(terminal.shown(), progress_line(halfway()) + "\r\n");
}

TEST(ConsoleText, QuotesFilesWithoutObeyingThem) {
    const auto text =
        written([](std::FILE* file) { Console(file).message("The checkpoint \x1b[2J cannot be read."); });
    EXPECT_EQ(text, "The checkpoint \\x1b[2J cannot be read.\n");
}

}  // namespace
}  // namespace cale
