// What a sweep shows of its runs.
#include "sweep/table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>
#include <string>
#include <vector>

#include "cale/fields.h"
#include "cale/text.h"
#include "support/terminal.h"
#include "sweep/sweep_console.h"

namespace cale {
namespace {

RunRow row(const std::string& name, const RunStatus& status) {
    return {.name = name,
            .state = std::string(name_of(status.state)),
            .status = status,
            .end = {.total_steps = 1000}};
}

std::vector<RunRow> some_rows() {
    return {row("Pong__sac__1", {.state = RunPhase::finished, .step = 1000, .mean_return = -20.5}),
            row("Pong__sac__2", {.state = RunPhase::running, .step = 400, .steps_per_second = 20}),
            row("Pong__sac__3", {.state = RunPhase::running, .step = 200, .steps_per_second = 30}),
            row("Pong__sac__4", {.state = RunPhase::interrupted, .step = 500}),
            row("Pong__sac__5", {.state = RunPhase::failed, .step = 100, .message = "exit code 1: it broke"}),
            row("Pong__sac__6", {})};
}

TEST(SweepTable, SumsUpTheSweep) {
    // 600 + 800 + 500 + 1000 steps are left, at 50 a second; the failed run takes none of them.
    EXPECT_EQ(summary(some_rows()),
              "6 runs: 1 finished, 1 failed, 2 running, 1 interrupted, 1 waiting  |  50 steps/s, ETA 0:58");
    EXPECT_EQ(summary(std::vector<RunRow>{row("a", {.state = RunPhase::finished, .step = 1000})}),
              "1 run: 1 finished");
}

TEST(SweepTable, ShowsABatchSystemsOwnStates) {
    auto rows = some_rows();
    rows[5].state = "pending";
    EXPECT_THAT(summary(rows), testing::HasSubstr("1 interrupted, 1 pending"));
    EXPECT_THAT(table(rows, 200), testing::HasSubstr("Pong__sac__6      pending"));
}

TEST(SweepTable, HasALineForEachRunAndWhyOneFailed) {
    const auto text = table(some_rows(), 200);
    EXPECT_THAT(text,
                testing::HasSubstr("Pong__sac__1      finished             1000/1000         -      -20.5"));
    EXPECT_THAT(text,
                testing::HasSubstr(
                    "Pong__sac__3      running               200/1000      30.0          -      0:27\n"));
    EXPECT_THAT(text, testing::HasSubstr("failed                100/1000         -          -         -\n"
                                         "  exit code 1: it broke\n"));
}

TEST(SweepTable, SaysThatARunPlaysItsLastEvaluation) {
    std::vector rows{row("a", {.state = RunPhase::running, .step = 1000, .steps_per_second = 20})};
    EXPECT_THAT(table(rows, 200),
                testing::HasSubstr("evaluating           1000/1000         -          -         -"));
    EXPECT_EQ(summary(rows), "1 run: 1 running") << "it makes no more steps";
    rows[0].end.evaluates = false;
    EXPECT_THAT(table(rows, 200),
                testing::HasSubstr("running              1000/1000         -          -         -"));
}

TEST(SweepTable, SaysAllThatARunIsRefusedFor) {
    const auto refused = row("Pong__sac__1", {.state = RunPhase::refused,
                                              .step = 400,
                                              .message = "trained with other settings: agent.loss was huber "
                                                         "and is now mse; give the sweep another --dir"});
    EXPECT_EQ(summary(std::vector<RunRow>{refused}), "1 run: 1 refused");
    EXPECT_THAT(table(std::vector<RunRow>{refused}, 200),
                testing::EndsWith("\n  trained with other settings: agent.loss was huber and is now mse; "
                                  "give the sweep another --dir\n"));
    EXPECT_THAT(table(std::vector<RunRow>{refused}, 86),
                testing::EndsWith("and is now mse; give the sweep\n  another --dir\n"))
        << "a narrow terminal takes nothing away from it";
}

TEST(SweepTable, LetsNoControlCharacterThrough) {
    for (const auto state : {RunPhase::failed, RunPhase::refused}) {
        const auto given = row("Pong__sac__1", {.state = state, .message = "agent.loss was \x1b[31mred"});
        EXPECT_THAT(table(std::vector<RunRow>{given}, 200), testing::Not(testing::HasSubstr("\x1b")));
    }
}

TEST(SweepTable, IsNoWiderThanTheTerminal) {
    auto rows = some_rows();
    rows[0].name = "SpaceInvaders__sac__encoder=phi_sac__exploration=epsilon_greedy__12345";
    rows[4].status.message = std::string(500, 'x');
    rows[1].end.total_steps = 10'000'000'000;
    for (const std::size_t width : {100, 80, 60, 8, 2}) {
        std::istringstream lines(table(rows, width));
        for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), width) << line;
    }
    EXPECT_THAT(table(rows, 100), testing::HasSubstr("greedy__12345  ")) << "the seed tells runs apart";
}

TEST(SweepTable, CutsNoCharacterInTwo) {
    auto rows = some_rows();
    for (std::size_t length = 30; length < 40; ++length) {
        rows[4].status.message = std::string(length, 'x');
        for (int i = 0; i < 100; ++i) rows[4].status.message += "\xc3\xa4";
        std::istringstream lines(table(rows, 80));
        for (std::string line; std::getline(lines, line);)
            EXPECT_EQ(line, printable(line)) << "which writes what is no UTF-8 as \\x..";
    }
}

TEST(SweepConsole, DrawsTheRunningRunsAndWipesThemForALine) {
    test::Terminal terminal(80);
    SweepConsole console(terminal.file(), /*live_table=*/true);
    EXPECT_TRUE(console.due());
    const std::vector<RunRow> rows{
        row("Pong__sac__1", {.state = RunPhase::running, .step = 400, .steps_per_second = 20}),
        row("Pong__sac__2", {})};
    console.show(rows);
    const auto drawn = terminal.shown();
    EXPECT_THAT(drawn, testing::StartsWith(summary(rows) + "\r\n"));
    EXPECT_THAT(drawn, testing::HasSubstr("Pong__sac__1      running"));
    EXPECT_THAT(drawn, testing::Not(testing::HasSubstr("Pong__sac__2")));
    console.say("a line");
    EXPECT_EQ(terminal.shown(), "\033[3A\033[Ja line\r\n");
    EXPECT_TRUE(console.due());
}

}  // namespace
}  // namespace cale
