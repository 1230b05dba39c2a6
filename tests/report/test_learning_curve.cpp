#include "report/learning_curve.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "support/temporary_folder.h"

namespace cale {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;

class LearningCurve : public ::testing::Test {
  protected:
    std::filesystem::path file(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name) << text;
        return folder_ / name;
    }

    const test::TemporaryFolder temporary_;
    const std::filesystem::path& folder_ = temporary_.path();
};

std::string error_of(const std::filesystem::path& path) {
    return test::error_of<std::runtime_error>([&] { read_episodes(path); });
}

TEST_F(LearningCurve, ReadsWhatARunWrites) {
    const auto path = file("episodes.csv",
                           "#{\"t_start\":0.0,\"env_id\":\"ALE/Pong-v5\",\"agent\":\"sac\",\"seed\":1}\n"
                           "r,l,t,global_step,frame,seed,env,truncated\n"
                           "-21,764,50.9,764,3056,1,0,0\n"
                           "-19.5,800,104.3,1564,6256,1,0,0\n"
                           "-2");  // the run was killed here
    const auto episodes = read_episodes(path);
    EXPECT_EQ(episodes.env_id, "ALE/Pong-v5");
    EXPECT_THAT(episodes.steps, ElementsAre(764, 1564));
    EXPECT_THAT(episodes.returns, ElementsAre(-21, -19.5));
}

TEST_F(LearningCurve, ALineThatIsNoGameIsDamageAlsoWhereItStartsLikeAComment) {
    const auto path = file("episodes.csv", "#{\"seed\":1}\nr,l,t\n-21,764,50.9\n#19.5,800\n");
    EXPECT_THAT(error_of(path), HasSubstr("is damaged: line 4"));
}

TEST_F(LearningCurve, CountsStepsOfMonitorFilesFromLengths) {
    const auto path =
        file("monitor.csv",
             "#{\"t_start\": 1.5, \"env_id\": \"CartPole-v1\"}\r\nr,l,t\r\n9.0,9,0.1\r\n8.0,11,0.2\r\n");
    const auto episodes = read_episodes(path);
    EXPECT_EQ(episodes.env_id, "CartPole-v1");
    EXPECT_THAT(episodes.steps, ElementsAre(9, 20));
}

TEST_F(LearningCurve, NamesTheLineThatIsDamaged) {
    EXPECT_THAT(error_of(file("a.csv", "#{}\nr,l,t,global_step\n1,2,3,4\n1,x,3,nan\n")),
                HasSubstr("line 4 is '1,x,3,nan'"));
    EXPECT_THAT(error_of(file("b.csv", "r,l,t,global_step\n1,2,3,4,5\n")), HasSubstr("line 2"));
    EXPECT_THAT(error_of(file("c.csv", "frame,score\n1,2\n")), HasSubstr("is not an episodes.csv"));
    EXPECT_THAT(error_of(file("d.csv", "")), HasSubstr("has no header"));
    EXPECT_THAT(error_of(folder_ / "missing.csv"), HasSubstr("missing.csv"));
}

TEST_F(LearningCurve, AveragesOverTheNewestValues) {
    EXPECT_THAT(moving_average({1, 3, 5, 7}, 2), ElementsAre(1, 2, 4, 6));
    EXPECT_THAT(moving_average({1, 3}, 100), ElementsAre(1, 2));
}

TEST_F(LearningCurve, AveragesOverTheNewestSteps) {
    const EpisodeHistory episodes{.steps = {10, 30, 35, 200, 200}, .returns = {1, 3, 8, 10, 20}};
    const auto newest = mean_returns(episodes, 20, 300);
    EXPECT_THAT(newest.steps, ElementsAre(10, 30, 35, 50, 200, 220, 300));
    EXPECT_THAT(newest.values, ElementsAre(1, 3, 5.5, 8, 15, 20, 20));
    const auto all = mean_returns(episodes, 1e9, 200);
    EXPECT_THAT(all.steps, ElementsAre(10, 30, 35, 200));
    EXPECT_THAT(all.values, ElementsAre(1, 2, 4, 8.4));
    EXPECT_THAT(mean_returns({}, 20, 100).steps, IsEmpty());
    EXPECT_THAT(mean_returns({.steps = {0, 0}, .returns = {1, 3}}, 0, 0).values, ElementsAre(3));
}

TEST_F(LearningCurve, ShowsEveryReturnAndTheirAverage) {
    EpisodeHistory episodes;
    for (int i = 0; i < 20; ++i) {
        episodes.steps.push_back(100 * (i + 1));
        episodes.returns.push_back(i % 2 == 0 ? 0 : 10);
    }
    const auto picture = learning_curve(episodes, "Pong");
    std::vector<Line> curves;
    for (const auto& line : picture.lines) {
        if (line.points.size() == 20) curves.push_back(line);
    }
    ASSERT_EQ(curves.size(), 2u);
    const auto& [returns, averages] = std::pair(curves[0].points, curves[1].points);
    EXPECT_LT(curves[0].width, curves[1].width);
    EXPECT_LT(returns[1].y, returns[0].y) << "a higher return is higher up";
    // The window is a tenth of the episodes, 2: but for the first, every average is 5.
    EXPECT_DOUBLE_EQ(averages[0].y, returns[0].y);
    for (std::size_t i = 1; i < 20; ++i) {
        EXPECT_NEAR(averages[i].y, (returns[0].y + returns[1].y) / 2, 1e-9);
        EXPECT_NEAR(returns[i].x - returns[i - 1].x, returns[1].x - returns[0].x, 1e-9)
            << "steps are equidistant";
    }
}

TEST_F(LearningCurve, StaysSmallWithoutLosingExtremes) {
    EpisodeHistory episodes;
    for (int i = 0; i < 100'000; ++i) {
        episodes.steps.push_back(i + 1);
        episodes.returns.push_back(i == 54'321 ? 1000 : i % 7);
    }
    const auto picture = learning_curve(episodes, "Pong");
    double highest = picture.height;
    for (const auto& line : picture.lines) {
        EXPECT_LE(line.points.size(), 4u * 800);
        if (line.points.size() <= 2) continue;
        for (const auto& point : line.points) highest = std::min(highest, point.y);
    }
    EpisodeHistory outlier{.steps = {54'322, 100'000}, .returns = {1000, 0}};
    double expected = picture.height;
    for (const auto& line : learning_curve(outlier, "").lines) {
        if (line.points.size() == 2 && line.width < 1) expected = line.points[0].y;
    }
    EXPECT_NEAR(highest, expected, 1e-6);
}

std::vector<std::string> texts(const Picture& picture) {
    std::vector<std::string> all;
    for (const auto& words : picture.words) all.push_back(words.text);
    return all;
}

TEST_F(LearningCurve, DrawsReferencesThatLeaveTheCurveVisible) {
    const EpisodeHistory episodes{.steps = {100, 200, 300}, .returns = {-21, -20, -15}};
    const auto picture = learning_curve(episodes, "Pong", {{"random", -20.7}, {"human", 14.6}});
    const auto dashed = std::count_if(picture.lines.begin(), picture.lines.end(),
                                      [](const Line& line) { return line.dashed; });
    EXPECT_EQ(dashed, 1);
    EXPECT_THAT(texts(picture), Contains("random -20.7"));
    EXPECT_THAT(texts(picture), IsSupersetOf({"human 14.6", "(far above)"}));
}

TEST_F(LearningCurve, WritesReferencesAsScoresArePublished) {
    const EpisodeHistory episodes{.steps = {100, 200}, .returns = {0, 1}};
    const auto picture = learning_curve(episodes, "Pong", {{"random", 2.0 / 3}, {"human", -1e-9}});
    EXPECT_THAT(texts(picture), IsSupersetOf({"random 0.7", "human 0"}));
}

TEST_F(LearningCurve, SaysWhenThereIsNothingToShow) {
    EXPECT_THAT(texts(learning_curve({}, "Pong")), Contains("no episode has ended yet"));
}

TEST_F(LearningCurve, OneEpisodeAndConstantReturnsStayInsideThePicture) {
    for (const auto& line : learning_curve({.steps = {500}, .returns = {7}}, "Pong").lines) {
        for (const auto& point : line.points) {
            EXPECT_TRUE(point.x >= 0 && point.x <= 800 && point.y >= 0 && point.y <= 450)
                << point.x << ' ' << point.y;
        }
    }
}

TEST(PictureFile, SvgIsXmlThatShowsTheData) {
    Picture picture{.width = 100, .height = 50, .title = "a < b & \"c\""};
    picture.lines.push_back({{{1, 2}, {30.25, 40}}, {255, 0, 16}, 1.5, true});
    picture.words.push_back({"R&D <1>", {5, 6}, {0, 0, 0}, 12, Anchor::end, true});
    const auto svg = to_svg(picture);
    EXPECT_THAT(svg, HasSubstr("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 100 50\""));
    EXPECT_THAT(svg, HasSubstr("<title>a &lt; b &amp; &quot;c&quot;</title>"));
    EXPECT_THAT(svg, HasSubstr("stroke=\"#ff0010\""));
    EXPECT_THAT(svg, HasSubstr("points=\"1.0,2.0 30.2,40.0\""));
    EXPECT_THAT(svg, HasSubstr("stroke-dasharray"));
    EXPECT_THAT(svg, HasSubstr("text-anchor=\"end\" font-weight=\"bold\">R&amp;D &lt;1&gt;</text>"));
}

TEST(PictureFile, PngIsDrawnFromTheSameData) {
    const test::TemporaryFolder folder;
    const auto path = folder / "picture.png";
    Picture picture{.width = 100, .height = 50};
    picture.lines.push_back({{{0, 25}, {100, 25}}, {200, 0, 0}, 4});
    write_picture(picture, path);
    const auto image = cv::imread(path.string());
    ASSERT_EQ(image.size(), cv::Size(200, 100));
    EXPECT_EQ(image.at<cv::Vec3b>(50, 100), cv::Vec3b(0, 0, 200));
    EXPECT_EQ(image.at<cv::Vec3b>(20, 100), cv::Vec3b(255, 255, 255));
}

TEST(PictureFile, SaysWhatItCannotWrite) {
    EXPECT_THROW(write_picture({}, "curve.jpg"), std::invalid_argument);
    EXPECT_THROW(write_picture({}, "/nowhere/curve.svg"), std::runtime_error);
}

}  // namespace
}  // namespace cale
