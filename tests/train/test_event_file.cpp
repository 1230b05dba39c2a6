#include "train/event_file.h"
#include "train/tensorboard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "support/temporary_folder.h"

namespace cale {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::ThrowsMessage;

TEST(TfRecord, FramesItsBytes) {
    const auto record = tf_record("abc");
    EXPECT_EQ(record.size(), 8u + 4 + 3 + 4);
    EXPECT_EQ(record.substr(0, 8), std::string("\x03\0\0\0\0\0\0\0", 8));
    EXPECT_EQ(record.substr(12, 3), "abc");
}

class EventFileOfARun : public ::testing::Test {
  protected:
    nlohmann::json read() const { return test::read_by_tensorboard(folder_); }

    const test::TemporaryFolder temporary_;
    const std::filesystem::path& folder_ = temporary_.path();
};

TEST_F(EventFileOfARun, IsReadByTensorBoard) {
    EventFile file(folder_);
    const std::vector<std::pair<std::string, std::string>> values = {
        {"agent", "sac"}, {"sac.gamma", "0.99"}, {"odd", "a|b"}};
    file.write_hyperparameters(values);
    file.write(1000, {{"losses/qf_loss", 0.25}, {"charts/SPS", 512}});
    file.write(5'000'000'000, {{"losses/qf_loss", -1e-3}});

    const auto events = read();  // while the file is still open
    EXPECT_EQ(events["file_version"], 2.0);
    EXPECT_EQ(events["scalars"]["charts/SPS"], nlohmann::json::parse("[[1000, 512]]"));
    const auto& losses = events["scalars"]["losses/qf_loss"];
    ASSERT_EQ(losses.size(), 2u);
    EXPECT_EQ(losses[0], nlohmann::json::parse("[1000, 0.25]"));
    EXPECT_EQ(losses[1][0], 5'000'000'000);
    EXPECT_NEAR(losses[1][1].get<double>(), -1e-3, 1e-9);
    EXPECT_EQ(events["texts"]["hyperparameters/text_summary"][0],
              "|name|value|\n|-|-|\n|agent|sac|\n|sac.gamma|0.99|\n|odd|a\\|b|");
    EXPECT_EQ(events["plugins"]["hyperparameters/text_summary"], "text");
}

TEST_F(EventFileOfARun, AResumedSessionVoidsWhatCameAfterItsCheckpoint) {
    EventFile first(folder_);
    first.write(10, {{"a", 1}});
    first.write(20, {{"a", 2}});
    first.write(30, {{"a", 3}});
    EventFile second(folder_, 20);
    EXPECT_NE(first.path(), second.path());
    second.write(25, {{"a", 7}});
    EXPECT_EQ(read()["scalars"]["a"], nlohmann::json::parse("[[10, 1], [20, 2], [25, 7]]"));
}

TEST_F(EventFileOfARun, IsNamedAsTensorBoardExpects) {
    const EventFile file(folder_);
    EXPECT_THAT(file.path().filename().string(),
                MatchesRegex("events\\.out\\.tfevents\\.[0-9]{10}\\..+\\.[0-9]+\\.0"));
}

TEST_F(EventFileOfARun, RefusesWhatTensorBoardCannotShow) {
    EventFile file(folder_);
    const auto empty = std::filesystem::file_size(file.path());
    const std::vector<std::pair<std::string, std::string>> values{{"env.roms", "/home/m\xfcller"}};
    const auto refused = [&](const std::string& text) {
        return ThrowsMessage<std::runtime_error>("TensorBoard cannot show '" + text +
                                                 "': it is not UTF-8; rename that metric or setting");
    };
    EXPECT_THAT([&] { file.write(1, {{"losses/a", 1}, {"losses/\xff", 2}}); }, refused("losses/\\xff"));
    EXPECT_THAT([&] { file.write_hyperparameters(values); }, refused("/home/m\\xfcller"));
    EXPECT_EQ(std::filesystem::file_size(file.path()), empty);
    file.write(1, {{"losses/\u03b1", 2}});
    EXPECT_EQ(read()["scalars"], nlohmann::json::parse(R"({"losses/\u03b1": [[1, 2]]})"));
}

TEST_F(EventFileOfARun, SaysWhyItCannotBeWritten) {
    try {
        EventFile file(folder_ / "missing");
        FAIL() << "no error";
    } catch (const std::runtime_error& error) {
        EXPECT_THAT(error.what(), HasSubstr("No such file or directory"));
        EXPECT_THAT(error.what(), HasSubstr("events.out.tfevents"));
    }
}

}  // namespace
}  // namespace cale
