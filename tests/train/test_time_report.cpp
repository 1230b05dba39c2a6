#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/temporary_folder.h"
#include "train/log.h"
#include "train/time_report.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

const std::string kHeader =
    "global_step,frame,seconds,steps_per_second,losses/td_loss,time/act,time/environment,time/log,"
    "time/replay,time/transfer,time/update\n";

TEST(TimeReport, WeighsEachRowByItsSeconds) {
    const test::TemporaryFolder folder;
    // 2 s of environment alone, then 8 s of which three quarters are updates: 6 of 10 s.
    folder.write("progress.csv", kHeader +
                                     "1000,4000,2,500,,0,1,0,0,0,0\n"
                                     "2000,8000,10,125,0.5,0,0.25,0,0,0,0.75\n");
    const auto report = time_report(folder.path());
    EXPECT_THAT(report, HasSubstr("2000 agent steps in 10.0 s, 200.0 a second"));
    EXPECT_THAT(report, HasSubstr("environment   40.0%        2.000"));
    EXPECT_THAT(report, HasSubstr("update        60.0%        3.000"));
    EXPECT_THAT(report, HasSubstr("log            0.0%        0.000"));
}

TEST(TimeReport, LeavesOutARowWithoutTimes) {
    // As a finished run that is resumed writes it.
    const test::TemporaryFolder folder;
    folder.write("progress.csv", kHeader +
                                     "1000,4000,2,500,,0,1,0,0,0,0\n"
                                     "2000,8000,10,0,0.5,,,,,,\n");
    EXPECT_THAT(time_report(folder.path()), HasSubstr("environment  100.0%        2.000"));
    folder.write("progress.csv", kHeader + "2000,8000,10,0,0.5,,,,,,\n");
    EXPECT_THAT([&] { time_report(folder.path()); },
                ThrowsMessage<std::runtime_error>(HasSubstr("has no row with times")));
}

TEST(TimeReport, SaysWhatIsMissing) {
    const test::TemporaryFolder folder;
    EXPECT_THAT([&] { time_report(folder.path()); },
                ThrowsMessage<std::runtime_error>(HasSubstr("progress.csv")));
    EXPECT_THAT([&] { time_report(folder.path() / "none"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("there is no folder")));
    folder.write("progress.csv", kHeader);
    EXPECT_THAT([&] { time_report(folder.path()); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("progress.csv"), HasSubstr("log.every"))));
    folder.write("progress.csv", "global_step,frame,seconds,steps_per_second\n1000,4000,2,500\n");
    EXPECT_THAT([&] { time_report(folder.path()); },
                ThrowsMessage<std::runtime_error>(HasSubstr("time/environment")));
}

TEST(TimeReport, RefusesARowWithoutNumbers) {
    const test::TemporaryFolder folder;
    folder.write("progress.csv", kHeader + "1000,4000,nan,500,,0,1,0,0,0,0\n");
    EXPECT_THAT([&] { time_report(folder.path()); },
                ThrowsMessage<std::runtime_error>(
                    HasSubstr("progress.csv is damaged: a row without steps or seconds")));
}

TEST(ReadProgress, RefusesWhatIsNoTable) {
    const test::TemporaryFolder folder;
    const auto path = folder.path() / "progress.csv";
    folder.write("progress.csv", "global_step,seconds\n1000,2\n2000\n");
    EXPECT_THAT([&] { read_progress(path); },
                ThrowsMessage<std::runtime_error>(HasSubstr("'2000' has 1 cells")));
    folder.write("progress.csv", "global_step,seconds\n1000,2x\n");
    EXPECT_THAT([&] { read_progress(path); },
                ThrowsMessage<std::runtime_error>(HasSubstr("seconds is '2x'")));
    // A line that a killed run left half written is not there yet.
    folder.write("progress.csv", "global_step,seconds\n1000,2\n2000,");
    EXPECT_EQ(read_progress(path).at("seconds"), std::vector<double>{2});
}

}  // namespace
}  // namespace cale
