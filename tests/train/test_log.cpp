#include "train/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "report/learning_curve.h"
#include "storage/files.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StrEq;

class Log : public ::testing::Test {
  protected:
    std::string text(const std::string& name) const {
        std::ifstream file(folder_ / name);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    void append(const std::string& name, const std::string& more) const {
        std::ofstream(folder_ / name, std::ios::app) << more;
    }

    const test::TemporaryFolder temporary_;
    const std::filesystem::path& folder_ = temporary_.path();
};

std::string error_of(const std::function<void()>& action) {
    return test::error_of<std::runtime_error>(action);
}

const EpisodeLogHeader kRun{.env_id = "ALE/Pong-v5", .agent = "sac", .seed = 7};

Episode episode(int number) {
    return {.episode_return = -21.0 + number,
            .length = 100,
            .global_step = 100 * number,
            .frame = 400 * number,
            .env = 0,
            .truncated = number == 3};
}

TEST_F(Log, EpisodesAreAMonitorFile) {
    EpisodeLog log(folder_ / "episodes.csv", kRun);
    log.write({.episode_return = -19.5,
               .length = 764,
               .global_step = 764,
               .frame = 3060,
               .env = 2,
               .truncated = false});
    log.write(episode(3));
    const auto file = text("episodes.csv");
    ASSERT_EQ(file[0], '#');
    const auto first_line = nlohmann::json::parse(file.substr(1, file.find('\n')));
    EXPECT_EQ(first_line["t_start"], 0.0);
    EXPECT_EQ(first_line["env_id"], "ALE/Pong-v5");
    EXPECT_EQ(first_line["agent"], "sac");
    EXPECT_EQ(first_line["seed"], 7);
    EXPECT_EQ(file.substr(file.find('\n') + 1),
              "r,l,t,global_step,frame,seed,env,truncated\n"
              "-19.5,764,51.000000,764,3060,7,2,0\n"
              "-18,100,20.000000,300,1200,7,0,1\n");
}

TEST_F(Log, EpisodesAreReadableByTheReport) {
    EpisodeLog log(folder_ / "episodes.csv", kRun);
    for (int i = 1; i <= 3; ++i) log.write(episode(i));
    const auto episodes = read_episodes(folder_ / "episodes.csv");
    EXPECT_EQ(episodes.env_id, "ALE/Pong-v5");
    EXPECT_THAT(episodes.steps, ElementsAre(100, 200, 300));
    EXPECT_THAT(episodes.returns, ElementsAre(-20, -19, -18));
}

TEST_F(Log, AResumedRunsEpisodesAreTheUninterruptedRuns) {
    {
        EpisodeLog log(folder_ / "whole.csv", kRun);
        for (int i = 1; i <= 5; ++i) log.write(episode(i));
    }
    std::int64_t offset = 0;
    {
        EpisodeLog log(folder_ / "resumed.csv", kRun);
        log.write(episode(1));
        log.write(episode(2));
        offset = log.offset();
        log.write(episode(3));
        append("resumed.csv", "-17,10");  // killed while writing a row
    }
    EpisodeLog log(folder_ / "resumed.csv", kRun, offset);
    EXPECT_EQ(log.offset(), offset);
    for (int i = 3; i <= 5; ++i) log.write(episode(i));
    EXPECT_EQ(text("resumed.csv"), text("whole.csv"));
    EXPECT_EQ(log.offset(), static_cast<std::int64_t>(text("whole.csv").size()));
}

TEST_F(Log, RowsAreInTheFileAtOnce) {
    EpisodeLog log(folder_ / "episodes.csv", kRun);
    log.write(episode(1));
    EXPECT_THAT(text("episodes.csv"), HasSubstr("\n-20,100,"));
}

TEST_F(Log, APipeIsNoFileToContinue) {
    ASSERT_EQ(::mkfifo((folder_ / "pipe.csv").c_str(), 0600), 0);
    EXPECT_THAT(error_of([&] { EpisodeLog(folder_ / "pipe.csv", kRun, 10); }),
                EndsWith("pipe.csv is a pipe; remove it"));
}

TEST_F(Log, RefusesToContinueAFileThatWasCutShort) {
    EpisodeLog(folder_ / "episodes.csv", kRun);
    const auto message = error_of([&] { EpisodeLog(folder_ / "episodes.csv", kRun, 10'000); });
    EXPECT_THAT(message, HasSubstr("episodes.csv has "));
    EXPECT_THAT(message, HasSubstr("but 10000 when the checkpoint was written"));
    EXPECT_THAT(error_of([&] { EpisodeLog(folder_ / "none.csv", kRun, 10); }),
                HasSubstr("none.csv is missing, which had 10 bytes"));
}

TEST_F(Log, RefusesToContinueAFileThatWasChanged) {
    std::int64_t offset = 0;
    {
        EpisodeLog log(folder_ / "episodes.csv", kRun);
        log.write(episode(1));
        log.write(episode(2));
        offset = log.offset();
    }
    const auto whole = text("episodes.csv");
    const auto refusal_of = [&](std::size_t position, std::size_t count, const std::string& by) {
        auto changed = whole;
        write_file_atomically(folder_ / "episodes.csv", changed.replace(position, count, by) + "-1,1,");
        const auto message = error_of([&] { EpisodeLog(folder_ / "episodes.csv", kRun, offset); });
        EXPECT_EQ(text("episodes.csv"), changed + "-1,1,") << "nothing is cut off";
        return message;
    };
    const auto row = whole.find("\n-20,100,") + 1;
    EXPECT_THAT(refusal_of(row, 3, "-xy"), HasSubstr("episodes.csv is damaged: line 3 is '-xy,100,"));
    EXPECT_THAT(refusal_of(row, 3, "-200"), HasSubstr("episodes.csv was changed since the checkpoint was "));
    write_file_atomically(folder_ / "episodes.csv", whole + "no episode\n");
    { EpisodeLog(folder_ / "episodes.csv", kRun, offset); }
    EXPECT_EQ(text("episodes.csv"), whole) << "what is cut off may be anything";
}

TEST_F(Log, NamesTheFileAndTheReasonWhenItCannotWrite) {
    EXPECT_THAT(error_of([&] { EpisodeLog("/dev/full", kRun); }),
                StrEq("cannot write to '/dev/full': No space left on device"));
    EXPECT_THAT(error_of([&] { EpisodeLog(folder_ / "missing" / "episodes.csv", kRun); }),
                EndsWith("missing/episodes.csv': No such file or directory"));
}

TEST_F(Log, ProgressIsOneWideRowPerReport) {
    ProgressLog log(folder_ / "progress.csv");
    log.write({.global_step = 1000,
               .frame = 4000,
               .seconds = 2.5,
               .steps_per_second = 400,
               .scalars = {{"losses/b", 0.5}, {"losses/a", 2}}});
    log.write({.global_step = 2000,
               .frame = 8000,
               .seconds = 5,
               .steps_per_second = 400,
               .scalars = {{"losses/a", std::nan("")}}});
    EXPECT_EQ(text("progress.csv"),
              "global_step,frame,seconds,steps_per_second,losses/a,losses/b\n"
              "1000,4000,2.500,400.00,2,0.5\n"
              "2000,8000,5.000,400.00,nan,\n");
    EXPECT_EQ(log.rows(), 2);
}

TEST_F(Log, ProgressGainsAColumnForANewName) {
    ProgressLog log(folder_ / "progress.csv");
    log.write({.global_step = 1, .frame = 4, .seconds = 1, .steps_per_second = 1, .scalars = {}});
    log.write({.global_step = 2, .frame = 8, .seconds = 2, .steps_per_second = 1, .scalars = {{"b", 1}}});
    log.write({.global_step = 3,
               .frame = 12,
               .seconds = 3,
               .steps_per_second = 1,
               .scalars = {{"a", 3}, {"b", 2}}});
    EXPECT_EQ(text("progress.csv"),
              "global_step,frame,seconds,steps_per_second,b,a\n"
              "1,4,1.000,1.00,,\n"
              "2,8,2.000,1.00,1,\n"
              "3,12,3.000,1.00,2,3\n");
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1)
        << "nothing temporary is left";
}

TEST_F(Log, ProgressContinuesFromARowEvenIfColumnsCameSince) {
    std::int64_t rows = 0;
    {
        ProgressLog log(folder_ / "progress.csv");
        log.write({.global_step = 1, .frame = 4, .seconds = 1, .steps_per_second = 1, .scalars = {{"a", 1}}});
        rows = log.rows();
        log.write({.global_step = 2, .frame = 8, .seconds = 2, .steps_per_second = 1, .scalars = {{"b", 9}}});
        append("progress.csv", "3,1");
    }
    ProgressLog log(folder_ / "progress.csv", rows);
    log.write(
        {.global_step = 2, .frame = 8, .seconds = 3, .steps_per_second = 1, .scalars = {{"a", 2}, {"b", 3}}});
    EXPECT_EQ(text("progress.csv"),
              "global_step,frame,seconds,steps_per_second,a,b\n"
              "1,4,1.000,1.00,1,\n"
              "2,8,3.000,1.00,2,3\n");
    EXPECT_EQ(log.rows(), 2);
}

TEST_F(Log, ProgressHasItsColumnsInTheOrderOfAnUninterruptedRun) {
    const Report first{.global_step = 1, .frame = 4, .seconds = 1, .steps_per_second = 1, .scalars = {}};
    const Report third{
        .global_step = 3, .frame = 12, .seconds = 3, .steps_per_second = 1, .scalars = {{"a", 3}, {"b", 2}}};
    {
        ProgressLog log(folder_ / "progress.csv");
        log.write(first);
        log.write({.global_step = 2, .frame = 8, .seconds = 2, .steps_per_second = 1, .scalars = {{"b", 1}}});
        EXPECT_EQ(log.last_step(), 2);
    }
    ProgressLog log(folder_ / "progress.csv", 1);
    EXPECT_EQ(log.last_step(), 1);
    log.write(third);
    EXPECT_EQ(text("progress.csv"),
              "global_step,frame,seconds,steps_per_second,a,b\n"
              "1,4,1.000,1.00,,\n"
              "3,12,3.000,1.00,3,2\n");
}

TEST_F(Log, ProgressContinuesFromNothing) {
    { ProgressLog log(folder_ / "progress.csv"); }
    ProgressLog log(folder_ / "progress.csv", 0);
    log.write({.global_step = 1, .frame = 4, .seconds = 1, .steps_per_second = 1, .scalars = {{"a", 1}}});
    EXPECT_EQ(text("progress.csv"), "global_step,frame,seconds,steps_per_second,a\n1,4,1.000,1.00,1\n");
}

TEST_F(Log, ProgressRefusesAFileWithFewerRows) {
    { ProgressLog(folder_ / "progress.csv").write({}); }
    EXPECT_THAT(error_of([&] { ProgressLog(folder_ / "progress.csv", 2); }),
                HasSubstr("does not have the 2 rows"));
}

TEST_F(Log, ProgressRefusesNamesThatAreNoColumns) {
    ProgressLog log(folder_ / "progress.csv");
    EXPECT_THROW(log.write({.scalars = {{"a,b", 1}}}), std::invalid_argument);
    EXPECT_EQ(test::error_of<std::invalid_argument>([&] {
                  log.write({.scalars = {{"seconds", 1}}});
              }),
              "the scalar 'seconds' cannot name a column: progress.csv has one of that name");
}

TEST_F(Log, ProgressWithTwoColumnsOfOneNameIsRefused) {
    const auto file = folder_ / "progress.csv";
    std::ofstream(file) << "global_step,frame,seconds,steps_per_second,a,a\n1,4,1.000,1.00,1,2\n";
    EXPECT_EQ(error_of([&] { read_progress(file); }), file.string() + ": two columns are called a");
}

TEST_F(Log, ADamagedTableIsToldInASentenceHoweverLongItsLines) {
    const std::string part(100, '9'), all(20'000, '9'), file = (folder_ / "table.csv").string();
    const auto read = [&](const std::string& table) {
        std::ofstream(folder_ / "table.csv") << table;
        return std::pair(error_of([&] { read_progress(folder_ / "table.csv"); }),
                         error_of([&] { read_episodes(folder_ / "table.csv"); }));
    };
    EXPECT_EQ(read("r,global_step\n" + all + "\n"),
              std::pair(file + ": '" + part + "' has 1 cells where the header has 2",
                        file + " is damaged: line 2 is '" + part + "'"));
    EXPECT_EQ(read("r,global_step\n" + all + "x,1\n"),
              std::pair(file + ": r is '" + part + "', which is no number",
                        file + " is damaged: line 2 is '" + part + "'"));
}

}  // namespace
}  // namespace cale
