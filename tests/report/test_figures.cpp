#include "report/figures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "cale/action.h"
#include "report/joystick_map.h"
#include "report/panel.h"
#include "report/run_folders.h"
#include "report/tables.h"

namespace cale {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class Figures : public ::testing::Test {
  protected:
    /// Two agents with long names, `games` games, two seeds, with events, zones and rewards.
    Comparison comparison(std::size_t game_count) const {
        for (const auto* agent : {"sac", "a_rather_long_name_of_an_agent"}) {
            std::size_t i = 0;
            for (const auto& game : games()) {
                if (i++ == game_count) break;
                for (const std::uint64_t seed : {1, 2}) {
                    const auto folder = fmt::format("{}_{}_{}", agent, game.rom, seed);
                    const double score = static_cast<double>(seed * 100 + i);
                    folders_.run(folder, agent, std::string(game.name), seed, {score, 50, 2 * score});
                    folders_.write(folder + "/joystick_events.csv", "event,count\nUP,3\nUPFIRE,1\n");
                    folders_.write(
                        folder + "/progress.csv",
                        "global_step,zones/centre,zones/right,zones/up_right,zones/up,zones/up_left,"
                        "zones/left,zones/down_left,zones/down,zones/down_right,zones/fire\n"
                        "100,0.5,0.5,0,0,0,0,0,0,0,1\n300,0,0,0,0.25,0,0.75,0,0,0,0\n");
                    folders_.write(folder + "/eval/step_000000300_rewards.csv",
                                   "quantile,reward\n0,0\n1,7\n");
                }
            }
        }
        return compare(find_runs({folders_.path()}, ScoreKind::training), {{"published", {{"Alien", 500}}}},
                       {.bootstrap = {.resamples = 200}});
    }

    test::RunFolders folders_{"figures"};
};

std::vector<std::string> words_of(const Picture& picture) {
    std::vector<std::string> all;
    for (const auto& words : picture.words) all.push_back(words.text);
    return all;
}

struct Box {
    double left, top, right, bottom;
};

Box box_of(const Text& words) {
    const double width = text_width(words.text, words.size, words.bold) * 0.9;
    const double left = words.position.x - (words.anchor == Anchor::start    ? 0
                                            : words.anchor == Anchor::middle ? width / 2
                                                                             : width);
    return {left, words.position.y - 0.7 * words.size, left + width, words.position.y};
}

/// No word over another, nothing outside the picture.
void expect_tidy(const Figure& figure) {
    SCOPED_TRACE(figure.name);
    const auto& picture = figure.picture;
    for (std::size_t i = 0; i < picture.words.size(); ++i) {
        const auto a = box_of(picture.words[i]);
        EXPECT_TRUE(a.left >= 0 && a.right <= picture.width && a.top >= 0 && a.bottom <= picture.height)
            << picture.words[i].text << " leaves the picture";
        for (std::size_t j = 0; j < i; ++j) {
            const auto b = box_of(picture.words[j]);
            EXPECT_TRUE(a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top)
                << '\'' << picture.words[i].text << "' overlaps '" << picture.words[j].text << '\'';
        }
    }
    const auto inside = [&](const std::vector<Point>& points) {
        return std::all_of(points.begin(), points.end(), [&](Point p) {
            return p.x >= 0 && p.x <= picture.width && p.y >= 0 && p.y <= picture.height;
        });
    };
    for (const auto& line : picture.lines) EXPECT_TRUE(inside(line.points));
    for (const auto& area : picture.areas) EXPECT_TRUE(inside(area.outline));
    for (const auto& mark : picture.marks) EXPECT_TRUE(inside(mark.outline));
}

/// Bars and bands; grid lines are opaque.
std::vector<Area> intervals_in(const Picture& picture) {
    std::vector<Area> found;
    std::copy_if(picture.areas.begin(), picture.areas.end(), std::back_inserter(found),
                 [](const Area& area) { return area.opacity < 1; });
    return found;
}

std::vector<std::string> names_of(const std::vector<Figure>& all) {
    std::vector<std::string> names;
    for (const auto& figure : all) names.push_back(figure.name);
    return names;
}

TEST(Legend, HasALineOfItsOwnForEachOfTwentyEightGroups) {
    Picture picture;
    draw_legend(picture, std::vector<std::string>(28, "a"), 0, 500, 0);
    const auto svg = to_svg(picture);
    std::set<std::string> lines;
    constexpr std::string_view begin = "<polyline fill=\"none\" ";
    for (auto at = svg.find(begin); at != svg.npos; at = svg.find(begin, at + 1))
        lines.insert(svg.substr(at, svg.find(" points=", at) - at));
    EXPECT_EQ(lines.size(), 28);
}

TEST_F(Figures, AreAllThereAndTidy) {
    for (const std::size_t game_count : {2u, 9u}) {
        const auto all = figures(comparison(game_count));
        EXPECT_THAT(names_of(all), ElementsAre("aggregates", "sample_efficiency", "performance_profiles",
                                               "probability_of_improvement", "game_curves", "game_scores",
                                               "events", "zones", "rewards"));
        for (const auto& figure : all) expect_tidy(figure);
    }
}

TEST_F(Figures, RunsThatAllScoredTheSameHaveFiguresToo) {
    for (const auto* game : {"Alien", "Amidar"})
        for (const std::uint64_t seed : {1, 2})
            folders_.run(fmt::format("{}_{}", game, seed), "sac", game, seed, {50, 50});
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    for (const auto& figure : figures(data)) expect_tidy(figure);
}

TEST_F(Figures, SayHowManyRunsAndWhichMethod) {
    const auto data = comparison(2);
    for (const auto& picture : {aggregate_figure(data), profile_figure(data), improvement_figure(data),
                                efficiency_figure(data), game_curves_figure(data)}) {
        std::string all;
        for (const auto& words : words_of(picture)) all += words + " ";
        EXPECT_THAT(all, HasSubstr("2 runs per game"));
        EXPECT_THAT(all, HasSubstr("200 resamples"));
        EXPECT_THAT(all, HasSubstr("95 %"));
    }
}

TEST_F(Figures, IntervalsAreDrawnWhereTheyAre) {
    auto data = comparison(2);
    data.baselines.clear();
    data.results[0].aggregates[0] = {.value = 0.5, .low = 0.4, .high = 0.8};
    data.results[1].aggregates[0] = {.value = 0.6, .low = 0.4, .high = 0.8};
    const auto picture = aggregate_figure(data);
    const auto bars = intervals_in(picture);
    ASSERT_EQ(bars.size(), 2 * kMetricCount);
    const auto& bar = bars[0].outline;
    const auto [left, right] =
        std::minmax_element(bar.begin(), bar.end(), [](Point a, Point b) { return a.x < b.x; });
    const auto across = std::find_if(picture.lines.begin(), picture.lines.end(),
                                     [](const Line& line) { return line.width == 1.8; });
    ASSERT_NE(across, picture.lines.end());
    EXPECT_NEAR((across->points[0].x - left->x) / (right->x - left->x), 0.25, 1e-9);
}

TEST_F(Figures, ASingleRunHasNoInterval) {
    folders_.run("a", "sac", "Pong", 1, {-20, -10});
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    EXPECT_TRUE(intervals_in(aggregate_figure(data)).empty());
    EXPECT_EQ(aggregate_figure(data).marks.size(), kMetricCount) << "a point for each metric";
    EXPECT_TRUE(intervals_in(efficiency_figure(data)).empty());
    EXPECT_TRUE(intervals_in(game_curves_figure(data)).empty());
    EXPECT_THAT(names_of(figures(data)), Not(Contains("probability_of_improvement")));
}

std::string text_of(const Picture& picture) {
    std::string all;
    for (const auto& words : words_of(picture)) all += words + " ";
    return all;
}

TEST_F(Figures, WithoutIntervalsClaimNone) {
    for (const auto* agent : {"sac", "dqn"}) folders_.run(agent, agent, "Pong", 1, {-20, -10});
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    const auto all = figures(data);
    ASSERT_EQ(all.size(), 6u);
    for (const auto& figure : all) {
        EXPECT_THAT(text_of(figure.picture), Not(HasSubstr("%"))) << figure.name;
        EXPECT_THAT(text_of(figure.picture), HasSubstr("no intervals")) << figure.name;
        EXPECT_THAT(figure.caption, Not(HasSubstr("interval,"))) << figure.name;
        EXPECT_THAT(figure.caption, Not(HasSubstr("An interval"))) << figure.name;
    }
}

TEST_F(Figures, EventsAreThoseOfTheScoreThatIsShown) {
    for (const std::uint64_t seed : {1, 2}) {
        const auto folder = fmt::format("{}", seed);
        folders_.run(folder, "sac", "Pong", seed, {-20, -10});
        folders_.write(folder + "/joystick_events.csv", "event,count\nUP,3\n");
        folders_.write(folder + "/eval/step_000000200.csv", "episode,return\n0,-20\n");
        folders_.write(folder + "/eval/step_000000200_events.csv", "event,count\nUP,3\n");
    }
    const auto text = [&](ScoreKind kind) {
        return text_of(event_figure(compare(find_runs({folders_.path()}, kind), {},
                                            {.score = kind, .bootstrap = {.resamples = 50}})));
    };
    EXPECT_THAT(text(ScoreKind::training), AllOf(HasSubstr("training"), Not(HasSubstr("evaluation"))));
    EXPECT_THAT(text(ScoreKind::evaluation),
                AllOf(HasSubstr("newest evaluation"), Not(HasSubstr("training"))));
}

TEST_F(Figures, GroupsWithoutEventsAreNotNamedBesideThem) {
    for (const std::string agent : {"sac", "dqn"})
        for (const std::string game : {"Alien", "Boxing", "Breakout", "Krull", "Pong"})
            folders_.run(agent + game, agent, game, 1, {-20, -10});
    for (const std::string game : {"Alien", "Boxing", "Breakout", "Krull", "Pong"})
        folders_.write("sac" + game + "/joystick_events.csv", "event,count\nUP,3\n");
    const auto comparison =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    const auto text = text_of(event_figure(comparison));
    EXPECT_THAT(text, AllOf(HasSubstr("mean over 5 games"), HasSubstr("sac"), Not(HasSubstr("dqn"))));
}

TEST_F(Figures, RunsWithoutEventsAreNotCounted) {
    folders_.run("1", "sac", "Pong", 1, {-20, -10});
    folders_.run("2", "sac", "Pong", 2, {-20, -10});
    folders_.write("1/joystick_events.csv", "event,count\nUP,3\n");
    const auto comparison =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    EXPECT_THAT(text_of(event_figure(comparison)), HasSubstr("mean over the runs (1 run per game)"));
}

TEST_F(Figures, LinesToCompareWithHaveLabels) {
    for (const std::uint64_t seed : {1, 2})
        folders_.run(fmt::format("{}", seed), "sac", "Alien", seed, {200, 400},
                     "env: {action_space: continuous, sticky_probability: 0.25}\n");
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training),
                {{"one", {{"Alien", 300}}}, {"same", {{"Alien", 301}}}, {"far", {{"Alien", 9e6}}}},
                {.bootstrap = {.resamples = 50}});
    const auto picture = game_curves_figure(data);
    const auto words = words_of(picture);
    EXPECT_THAT(words, Contains("dashed: a = random joystick (200m), b = one, c = same, d = far"));
    EXPECT_THAT(words, Contains("c b")) << "lines that touch share a place";
    EXPECT_THAT(words, Contains("a"));
    EXPECT_THAT(words, Not(Contains("d")));
    expect_tidy({.name = "game_curves", .picture = picture});
    EXPECT_THAT(words_of(efficiency_figure(data)), Contains("same"));
}

TEST_F(Figures, ManyBaselinesStayInThePictureAndFarOnesAreNamedBelow) {
    for (const std::uint64_t seed : {1, 2})
        folders_.run(fmt::format("{}", seed), "sac", "Alien", seed, {200, 400});
    std::vector<Baseline> baselines{{"far", {{"Alien", 9e6}}}};
    for (int i = 0; i < 40; ++i) baselines.push_back({fmt::format("b{}", i), {{"Alien", 228}}});
    const auto data = compare(find_runs({folders_.path()}, ScoreKind::training), baselines,
                              {.bootstrap = {.resamples = 50}});
    const auto picture = efficiency_figure(data);
    expect_tidy({.name = "sample_efficiency", .picture = picture});
    EXPECT_THAT(words_of(picture), Contains("b39"));
    EXPECT_THAT(text_of(picture), HasSubstr("left out, far from the curves: far"));
    EXPECT_THAT(text_of(game_curves_figure(data)), HasSubstr(" +3"));
}

TEST_F(Figures, APairWithoutAnIntervalClaimsNone) {
    folders_.run("a", "sac", "Pong", 1, {-20});
    for (const std::uint64_t seed : {1, 2})
        folders_.run(fmt::format("b{}", seed), "dqn", "Pong", seed, {-20});
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    EXPECT_THAT(text_of(improvement_figure(data)), AllOf(HasSubstr("no intervals"), Not(HasSubstr("%"))));
    EXPECT_THAT(text_of(game_figures(data).front().picture), HasSubstr("1-2 runs per game"));
}

TEST_F(Figures, SayWhatTheyLeaveOut) {
    folders_.run("a", "sac", "Pong", 1, {-20, -20}, "train: {total_steps: 1000}\n");
    folders_.run("b", "dqn", "Pong", 1, {400, 400}, "train: {total_steps: 200}\n");
    const auto data =
        compare(find_runs({folders_.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    EXPECT_THAT(text_of(efficiency_figure(data)), HasSubstr("to where the shortest run is, unfinished: sac"));
    EXPECT_THAT(text_of(profile_figure(data)), HasSubstr("some runs score more than 8"));
}

TEST(Panels, TicksLeaveRoomForTheirWords) {
    Panel panel{.left = 0, .top = 0, .right = 60, .bottom = 10, .x = {0, 1'000'000}};
    double width = 0;
    const auto ticks = fitting_ticks(panel, 10, 12);
    for (const auto& text : tick_texts(ticks)) width += text_width(text, 12);
    EXPECT_LE(width, 60);
    EXPECT_FALSE(ticks.empty());
}

TEST(Panels, NumbersThatDifferByRoundingHaveRoomAllTheSame) {
    const auto room = room_for(std::array{-0.0256, std::nextafter(-0.0256, 0)});
    EXPECT_NEAR(room.high - room.low, 2, 0.1);
}

TEST(Panels, TicksAreRoundNumbersInsideTheInterval) {
    EXPECT_THAT(nice_ticks(-21.3, 20.4, 6), ElementsAre(-20, -15, -10, -5, 0, 5, 10, 15, 20));
    EXPECT_THAT(nice_ticks(0, 100'000, 6), ElementsAre(0, 20'000, 40'000, 60'000, 80'000, 100'000));
    EXPECT_THAT(nice_ticks(0, 0.3, 3), ::testing::Pointwise(::testing::DoubleEq(), {0.0, 0.1, 0.2, 0.3}));
}

TEST(Panels, TicksHaveOneUnit) {
    EXPECT_THAT(tick_texts({0, 5'000, 10'000}), ElementsAre("0", "5k", "10k"));
    EXPECT_THAT(tick_texts({-2'000'000, 500'000}), ElementsAre("-2M", "0.5M"));
    EXPECT_THAT(tick_texts({0.25, 5'000}), ElementsAre("0.25", "5000"));
}

TEST(Panels, BreakLinesAtSpaces) {
    EXPECT_THAT(wrapped("one two three", 60, 10), ElementsAre("one two", "three"));
    EXPECT_THAT(wrapped("", 60, 10), ElementsAre());
}

TEST(PictureFile, BlendsAreasAndDrawsMarksOverLines) {
    const test::RunFolders folders("areas");
    Picture picture{.width = 40, .height = 40};
    picture.areas.push_back(rectangle(0, 0, 20, 40, {0, 0, 200}, 0.5));
    picture.lines.push_back({{{0, 30}, {40, 30}}, {0, 0, 0}, 4});
    picture.marks.push_back(disc({30, 30}, 6, {200, 0, 0}));
    write_picture(picture, folders.path() / "a.png");
    const auto image = cv::imread((folders.path() / "a.png").string());
    EXPECT_EQ(image.at<cv::Vec3b>(20, 20), cv::Vec3b(228, 128, 128));
    EXPECT_EQ(image.at<cv::Vec3b>(20, 60), cv::Vec3b(255, 255, 255));
    EXPECT_EQ(image.at<cv::Vec3b>(60, 60), cv::Vec3b(0, 0, 200));
    EXPECT_THAT(to_svg(picture), HasSubstr("fill-opacity=\"0.5\""));
}

TEST(JoystickMap, RegionsAreThoseOfTheMapping) {
    for (const double threshold : {0.0, 0.1, 0.5, 0.7, 0.9}) {
        SCOPED_TRACE(threshold);
        const auto regions = joystick_regions(threshold);
        for (int i = 0; i < 2000; ++i) {
            const double radius = std::sqrt(static_cast<double>(i) / 2000),
                         angle = std::remainder(2.4 * i, 6.283185307);
            const Point stick{radius * std::cos(angle), radius * std::sin(angle)};
            if (std::min(std::abs(std::abs(stick.x) - threshold), std::abs(std::abs(stick.y) - threshold)) <
                    1e-3 ||
                radius > 0.999)
                continue;
            const auto event = joystick_event(
                {.radius = static_cast<float>(radius), .theta = static_cast<float>(angle), .fire = 0},
                static_cast<float>(threshold));
            for (const auto& region : regions) {
                bool inside = true;  // convex, counter-clockwise
                for (std::size_t k = 0; k < region.outline.size(); ++k) {
                    const auto a = region.outline[k], b = region.outline[(k + 1) % region.outline.size()];
                    inside &= (b.x - a.x) * (stick.y - a.y) - (b.y - a.y) * (stick.x - a.x) >= -1e-9;
                }
                EXPECT_EQ(inside, region.event == event) << stick.x << ' ' << stick.y;
            }
        }
    }
    EXPECT_EQ(joystick_regions(0.5).size(), 9u);
    EXPECT_EQ(joystick_regions(0.8).size(), 5u) << "no corner is further out than sqrt(1/2)";
    EXPECT_EQ(joystick_regions(1.0).size(), 1u);
}

TEST(JoystickMap, SharesOfRandomActionsAddUp) {
    const auto shares = event_shares_of_random_actions(0.5);
    double sum = 0, fire = 0;
    for (std::size_t i = 0; i < shares.size(); ++i) {
        sum += shares[i];
        if (event_name(static_cast<Event>(i)).find("FIRE") != std::string_view::npos) fire += shares[i];
    }
    EXPECT_NEAR(sum, 1, 1e-9);
    EXPECT_NEAR(fire, 0.5, 1e-9);
    EXPECT_GT(shares[static_cast<std::size_t>(Event::noop)],
              shares[static_cast<std::size_t>(Event::up_left)]);
}

// docs/learning.md has the whole table.
TEST(JoystickMap, RandomActionsOfOtherCoordinatesReachOtherZones) {
    const auto share = [](Joystick joystick, Event event) {
        const auto shares = event_shares_of_random_actions(0.5, joystick);
        double sum = 0;
        for (const double part : shares) sum += part;
        EXPECT_NEAR(sum, 1, 1e-9);
        return shares[static_cast<std::size_t>(event)];
    };
    EXPECT_NEAR(share(Joystick::cartesian, Event::noop), 0.25 / 2, 0.001);
    EXPECT_NEAR(share(Joystick::cartesian, Event::up_left_fire), 0.0625 / 2, 0.001);
    EXPECT_NEAR(share(Joystick::factored, Event::up_left_fire), 1.0 / 18, 1e-9);
    EXPECT_NEAR(share(Joystick::direction, Event::noop), share(Joystick::polar, Event::noop), 0.03);
    EXPECT_THAT(joystick_map_text(0.5, Joystick::cartesian), HasSubstr("cartesian"));
    const auto of_paddle = event_shares_of_random_actions(0.33, Joystick::paddle);
    EXPECT_NEAR(of_paddle[static_cast<std::size_t>(Event::left)], 0.67 / 2 * 0.33, 1e-5);
}

TEST(JoystickMap, NamesAllEighteenEvents) {
    const auto all = words_of(joystick_map(0.5));
    for (int i = 0; i < kEventCount; ++i) {
        const std::string name(event_name(static_cast<Event>(i)));
        EXPECT_THAT(all, Contains(name));
        EXPECT_THAT(joystick_map_text(0.5), HasSubstr(name));
    }
    expect_tidy({.name = "map", .picture = joystick_map(0.5)});
    expect_tidy({.name = "map", .picture = joystick_map(0.95)});
    // Where no push is far enough, FIRE is in the disc with the button all the same, 0 %.
    const auto of_one = words_of(joystick_map(1));
    EXPECT_EQ(std::ranges::count(of_one, "NOOP"), 1);
    EXPECT_EQ(std::ranges::count(of_one, "FIRE"), 1);
}

TEST_F(Figures, EventsZonesAndRewardsAreTablesToo) {
    const auto files = csv_files(comparison(2));
    const auto text = [&](const std::string& name) {
        const auto found = std::ranges::find(files, name, &TextFile::name);
        return found == files.end() ? std::string() : found->text;
    };
    EXPECT_THAT(text("events.csv"),
                AllOf(HasSubstr("\nsac,Alien,UP,0.75\n"), HasSubstr("\nsac,Alien,UPFIRE,0.25\n")));
    // 40 parts of 300 steps: the row of step 100 ends in the 14th.
    EXPECT_THAT(text("zones.csv"),
                AllOf(HasSubstr("\nsac,Alien,105,right,0.5\n"), HasSubstr("\nsac,Alien,300,left,0.75\n")));
    EXPECT_THAT(text("rewards.csv"), HasSubstr("\nsac,Alien,1,7\n"));
}

}  // namespace
}  // namespace cale
