// Searches: what is drawn, which samples go on, and what is left behind.
#include "sweep/search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/text.h"
#include "settings/config.h"
#include "storage/files.h"
#include "support/temporary_folder.h"
#include "sweep/run_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::DoubleNear;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Optional;

SearchSpace space_of(std::int64_t samples, std::vector<SearchedSetting> settings, std::uint64_t seed = 1) {
    return {.samples = samples, .seed = seed, .settings = std::move(settings)};
}

TEST(SearchSpace, ReadsRanges) {
    const auto whole = number_range("1..10");
    ASSERT_TRUE(whole);
    EXPECT_TRUE(whole->whole);
    EXPECT_FALSE(whole->logarithmic);
    EXPECT_EQ(whole->high, 10);
    const auto steps = number_range("log 1_000..20_000");
    ASSERT_TRUE(steps);
    EXPECT_TRUE(steps->whole && steps->logarithmic);
    EXPECT_EQ(steps->high, 20'000);
    const auto rate = number_range("log 1e-5..0.001");
    ASSERT_TRUE(rate);
    EXPECT_FALSE(rate->whole);
    EXPECT_EQ(rate->low, 1e-5);
    for (const char* text : {"0.5", "a..b", "log 5", "phi_sac", "", "0..inf", "-inf..1", "log 1..inf"})
        EXPECT_FALSE(number_range(text)) << text;
    EXPECT_THAT(test::error_of<ConfigError>([] { number_range("3..1"); }),
                HasSubstr("the range 3..1 is empty"));
    EXPECT_THAT(test::error_of<ConfigError>([] { number_range("5..5"); }),
                HasSubstr("the range 5..5 has one value"));
    EXPECT_THAT(test::error_of<ConfigError>([] { number_range("log 0..1"); }), HasSubstr("above 0"));
    EXPECT_THAT(test::error_of<ConfigError>([] { number_range("0.1...9"); }),
                HasSubstr("the range 0.1...9 has three dots: write two"));
    EXPECT_TRUE(number_range("log 1e1..1e3")->whole);
    EXPECT_FALSE(number_range("1.0..2.0")->whole);
}

TEST(SearchSpace, DrawsEvenly) {
    const auto samples =
        draw_samples(space_of(2000, {{"a.even", NumberRange{.low = 2, .high = 4}},
                                     {"a.log", NumberRange{.low = 1e-4, .high = 1, .logarithmic = true}},
                                     {"a.choice", Choices{"x", "y", "z"}},
                                     {"a.whole", NumberRange{.low = 1, .high = 4, .whole = true}}}));
    ASSERT_EQ(samples.size(), 2000U);
    double even = 0, logarithm = 0;
    std::map<std::string, int> choices, integers;
    for (const auto& sample : samples) {
        ASSERT_EQ(sample[0].key, "a.even");
        even += *number_in<double>(sample[0].value);
        const auto value = *number_in<double>(sample[1].value);
        ASSERT_TRUE(value >= 1e-4 && value <= 1);
        logarithm += std::log10(value);
        ++choices[sample[2].value];
        ++integers[sample[3].value];
    }
    // Means of 2,000: 3 with a standard error of 0.013, and -2 with one of 0.026.
    EXPECT_NEAR(even / 2000, 3, 0.06);
    EXPECT_NEAR(logarithm / 2000, -2, 0.12);
    ASSERT_EQ(choices.size(), 3U);
    for (const auto& [choice, count] : choices) EXPECT_NEAR(count, 667, 100) << choice;
    ASSERT_EQ(integers.size(), 4U);
    for (const auto& [integer, count] : integers) EXPECT_NEAR(count, 500, 90) << integer;
}

TEST(SearchSpace, NumbersHaveAsManyDigitsAsTheirRangeNeedsAndLieInIt) {
    const std::vector<NumberRange> ranges{{.low = 0.9995, .high = 0.9999},
                                          {.low = 100.1, .high = 100.4},
                                          {.low = -1, .high = -0.99},
                                          {.low = 0, .high = 1e-3},
                                          {.low = 1e-5, .high = 1.234567e-3, .logarithmic = true}};
    for (const auto& range : ranges) {
        const auto samples = draw_samples(space_of(50, {{"a.b", range}}));
        for (const auto& sample : samples) {
            const auto value = number_in<double>(sample[0].value);
            ASSERT_TRUE(value && *value >= range.low && *value <= range.high) << sample[0].value;
        }
    }
    EXPECT_THAT(draw_samples(space_of(1, {{"a.b", NumberRange{.low = 1e-5, .high = 1}}}))[0][0].value.size(),
                testing::Le(6U));
}

TEST(SearchSpace, MoreSamplesOrSettingsChangeNoneOfThoseBefore) {
    const SearchedSetting rate{"agent.rate", NumberRange{.low = 1e-5, .high = 1e-2, .logarithmic = true}};
    const auto few = draw_samples(space_of(4, {rate}));
    const auto many =
        draw_samples(space_of(8, {rate, {"agent.size", NumberRange{.low = 1, .high = 9, .whole = true}}}));
    for (std::size_t i = 0; i < few.size(); ++i) EXPECT_EQ(few[i][0], many[i][0]);
    EXPECT_NE(draw_samples(space_of(4, {rate}, 2)), few) << "another seed";
}

TEST(SearchSpace, RepeatsNoSample) {
    const auto samples = draw_samples(space_of(4, {{"a.b", Choices{"1", "2", "3", "4"}}}));
    EXPECT_EQ(std::set(samples.begin(), samples.end(),
                       [](const auto& a, const auto& b) { return a[0].value < b[0].value; })
                  .size(),
              4U);
    EXPECT_THAT(test::error_of<ConfigError>([] {
                    draw_samples(space_of(5, {{"a.b", Choices{"1", "2", "3", "4"}}}));
                }),
                HasSubstr("no more than 4 different samples were found, of 5"));
}

TEST(Search, HalvingComparesTwiceAsLateEachTime) {
    SearchSpace space;
    EXPECT_THAT(rungs(SearchMethod::random, space, 1000), ElementsAre(1000));
    EXPECT_THAT(rungs(SearchMethod::halving, space, 1000), ElementsAre(125, 250, 500, 1000));
    space.first_steps = 300;
    EXPECT_THAT(rungs(SearchMethod::halving, space, 1000), ElementsAre(300, 600, 1000));
    space.first_steps = 1000;
    EXPECT_THAT(rungs(SearchMethod::halving, space, 1000), ElementsAre(1000));
    space.first_steps = 0;
    EXPECT_THAT(rungs(SearchMethod::halving, space, 5), ElementsAre(1, 2, 4, 5));
}

TEST(Search, AScoreIsOfTheNewestQuarterOfTheSteps) {
    const test::TemporaryFolder run;
    EXPECT_EQ(search_score(run.path(), 400), std::nullopt);
    run.write("episodes.csv",
              "#{}\nr,l,t,global_step\n1,9,0,100\n2,9,0,300\n4,9,0,301\n8,9,0,400\n100,9,0,401\n");
    EXPECT_THAT(search_score(run.path(), 400), Optional(6.0));
    EXPECT_THAT(search_score(run.path(), 300), Optional(2.0));
    EXPECT_THAT(search_score(run.path(), 250), Optional(1.0)) << "none ended there: the last one before";
    EXPECT_EQ(search_score(run.path(), 99), std::nullopt);
}

TEST(Search, SamplesAreRankedInEachCombination) {
    std::vector<SampleScore> samples = {
        {.sample = 1, .scores = {{"pong", -20.0}, {"krull", 900.0}}},
        {.sample = 2, .scores = {{"pong", -20.0}, {"krull", 3000.0}}},
        {.sample = 3, .scores = {{"pong", 5.0}, {"krull", std::nullopt}}},
        {.sample = 4, .scores = {{"pong", std::nullopt}, {"krull", std::nullopt}}},
    };
    rank(samples);
    std::vector<std::int64_t> order;
    std::vector<double> ranks;
    for (const auto& sample : samples) {
        order.push_back(sample.sample);
        ranks.push_back(sample.rank);
    }
    // Pong: 2.5, 2.5, 1, 4. Krull: 2, 1, 3.5, 3.5.
    EXPECT_THAT(order, ElementsAre(2, 1, 3, 4));
    EXPECT_THAT(ranks, ElementsAre(1.75, 2.25, 2.25, 3.75));
}

TEST(Search, ASampleThatFailedIsBehindOneInWhichNoGameHasEnded) {
    std::vector<SampleScore> samples = {
        {.sample = 1, .scores = {{"pong", std::nullopt}}, .failed = {"pong"}},
        {.sample = 2, .scores = {{"pong", std::nullopt}}},
        {.sample = 3, .scores = {{"pong", -21.0}}},
    };
    rank(samples);
    std::vector<std::int64_t> order;
    for (const auto& sample : samples) order.push_back(sample.sample);
    EXPECT_THAT(order, ElementsAre(3, 2, 1));
}

/// A search whose runs have the returns that `returns` says, by sample, where they are trained.
class HalvingSearch : public testing::Test {
  protected:
    HalvingSearch() {
        sweep_.name = "mine";
        sweep_.search = space_of(5, {{"agent.rate", NumberRange{.low = 1, .high = 2}}});
        sweep_.samples = draw_samples(*sweep_.search);
        for (std::int64_t sample = 1; sample <= 5; ++sample) {
            for (const std::string game : {"Pong", "Krull"}) {
                const SweepRun run{.name = fmt::format("{}__fake__sample={}__1", game, sample),
                                   .agent = "fake",
                                   .config = "/a/base.yaml",
                                   .game = game,
                                   .settings = sweep_.samples[static_cast<std::size_t>(sample) - 1],
                                   .sample = sample,
                                   .combination = game + "__fake__1"};
                runs_.push_back({.run = run, .program = {}, .end = {.total_steps = 400}});
            }
        }
    }

    Search what(SearchMethod method = SearchMethod::halving) {
        return {.sweep = sweep_,
                .runs = runs_,
                .method = method,
                .folder = folder_.path(),
                .train = [&](std::span<const PlannedRun> runs) { return train(runs); }};
    }
    int search(SearchMethod method = SearchMethod::halving) {
        trained_.clear();
        const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(std::fopen((folder_ / "said").c_str(), "w"),
                                                                  &std::fclose);
        return run_search(what(method), out.get());
    }
    /// The steps and samples that would be trained next.
    std::string next() {
        std::set<std::int64_t> samples;
        const auto runs = next_runs(what());
        for (const auto& planned : runs) samples.insert(planned.run.sample);
        return runs.empty() ? ""
                            : fmt::format("{}: {}", runs.front().end.total_steps, fmt::join(samples, " "));
    }

    int train(std::span<const PlannedRun> runs) {
        if (std::ssize(trained_) == stops_before_) return 130;
        std::set<std::int64_t> samples;
        for (const auto& planned : runs) {
            const auto name = planned.run.name;
            samples.insert(planned.run.sample);
            EXPECT_EQ(planned.until, planned.end.total_steps < 400 ? planned.end.total_steps : 0);
            EXPECT_EQ(planned.end.evaluates, planned.end.total_steps == 400);
            if (planned.run.sample == fails_) continue;
            std::string episodes = "#{}\nr,global_step\n";
            for (int step = 25; step <= planned.end.total_steps; step += 25)
                episodes +=
                    fmt::format("{},{}\n", equal_ ? 1 : planned.run.sample * (step > 100 ? 10 : -10), step);
            folder_.write(name + "/episodes.csv", ends_no_game_ ? "#{}\nr,global_step\n" : episodes);
            fs::create_directories(folder_ / name /
                                   fmt::format("checkpoints/step_{:09}", planned.end.total_steps));
            if (planned.end.evaluates)
                folder_.write(name + fmt::format("/eval/step_{:09}.csv", planned.end.total_steps), "");
            folder_.write(name + "/config.yaml", "");
        }
        trained_.push_back(fmt::format("{}: {}", runs.front().end.total_steps, fmt::join(samples, " ")));
        return fails_ > 0 ? 1 : 0;
    }

    test::TemporaryFolder folder_;
    Sweep sweep_;
    std::vector<PlannedRun> runs_;
    std::vector<std::string> trained_;
    std::ptrdiff_t stops_before_ = -1;
    std::int64_t fails_ = 0;
    bool equal_ = false, ends_no_game_ = false;
};

TEST_F(HalvingSearch, TheBetterHalfGoesOn) {
    sweep_.search->first_steps = 100;
    EXPECT_EQ(search(), 0);
    // At 100 steps the small numbers are ahead, from then on the large ones.
    EXPECT_THAT(trained_, ElementsAre("100: 1 2 3 4 5", "200: 1 2 3", "400: 2 3"));
    const auto said = folder_.read("said");
    EXPECT_THAT(said, HasSubstr("Agent step 100: the better 3 of 5 samples continue.\n"));
    EXPECT_THAT(said, HasSubstr("Agent step 400, the end:\n"));

    const auto value = [&](std::size_t sample) { return sweep_.samples[sample - 1][0].value; };
    EXPECT_EQ(folder_.read("search.csv"),
              fmt::format("sample,steps,rank,agent.rate,Krull__fake__1,Pong__fake__1\n"
                          "3,400,1.000,{},30.00,30.00\n"
                          "2,400,2.000,{},20.00,20.00\n"
                          "1,200,3.000,{},10.00,10.00\n"
                          "4,100,4.000,{},-40.00,-40.00\n"
                          "5,100,5.000,{},-50.00,-50.00\n",
                          value(3), value(2), value(1), value(4), value(5)));
    EXPECT_EQ(folder_.read("search_best.yaml"),
              fmt::format("# Sample 3 of 5 of mine, at agent step 400: mean rank 1.00 among 2.\n"
                          "extends: /a/base.yaml\n"
                          "agent:\n"
                          "  rate: {}\n",
                          value(3)));
}

TEST_F(HalvingSearch, GoesOnAfterAnInterruptionWithTheSameResult) {
    sweep_.search->first_steps = 100;
    ASSERT_EQ(search(), 0);
    const auto table = folder_.read("search.csv"), best = folder_.read("search_best.yaml");
    fs::remove(folder_ / "search_best.yaml");
    for (const auto& planned : runs_) fs::remove_all(folder_ / planned.run.name);
    EXPECT_EQ(next(), "100: 1 2 3 4 5");
    stops_before_ = 2;
    EXPECT_EQ(search(), 130);
    EXPECT_EQ(next(), "400: 2 3");
    EXPECT_FALSE(fs::exists(folder_ / "search_best.yaml"));
    stops_before_ = -1;
    EXPECT_EQ(search(), 0);
    EXPECT_EQ(folder_.read("search.csv"), table);
    EXPECT_EQ(folder_.read("search_best.yaml"), best);
    EXPECT_EQ(next(), "");
}

TEST_F(HalvingSearch, SaysWhereTheScoresDoNotDecide) {
    equal_ = true;
    ASSERT_EQ(search(), 0);
    EXPECT_THAT(
        folder_.read("said"),
        HasSubstr(
            "Their ranks do not tell samples 3 and 4 apart, so the one of the smaller number continues"));
    ASSERT_EQ(search(SearchMethod::random), 0);
    EXPECT_THAT(
        folder_.read("said"),
        HasSubstr("Their ranks do not tell samples 1 and 2 apart, so search_best.yaml is of the one"));
}

TEST_F(HalvingSearch, TheBestSettingsComeWithThoseThatAllRunsHave) {
    for (auto& planned : runs_) {
        planned.run.settings.insert(
            planned.run.settings.begin(),
            {{"env.obs", "ram"}, {"train.seed", "1"}, {"env.game", planned.run.game}});
    }
    runs_.front().run.settings.push_back({"log.every", "7"});  // of one run only
    ASSERT_EQ(search(), 0);
    const auto best = folder_.read("search_best.yaml");
    EXPECT_THAT(best, HasSubstr("agent:\n  rate: "));
    EXPECT_THAT(best, testing::EndsWith("env:\n  obs: ram\n"));
}

TEST_F(HalvingSearch, AllSamplesOfARandomSearchAreTrainedToTheEnd) {
    EXPECT_EQ(search(SearchMethod::random), 0);
    EXPECT_THAT(trained_, ElementsAre("400: 1 2 3 4 5"));
    EXPECT_THAT(folder_.read("search.csv"), HasSubstr("\n5,400,1.000,"));
    EXPECT_THAT(folder_.read("search_best.yaml"),
                HasSubstr("Sample 5 of 5 of mine, at agent step 400: mean rank 1.00 among 5"));
}

TEST_F(HalvingSearch, ARunThatFailedIsTheWorst) {
    fails_ = 1;
    EXPECT_EQ(search(), 1);
    EXPECT_THAT(trained_, ElementsAre("50: 1 2 3 4 5", "100: 2 3 4", "200: 2 3", "400: 3"));
    EXPECT_THAT(folder_.read("search.csv"),
                HasSubstr(fmt::format("1,50,5.000,{},,\n", sweep_.samples[0][0].value)));
}

TEST_F(HalvingSearch, WithoutAScoreNothingIsTheBest) {
    ends_no_game_ = true;
    search(SearchMethod::random);
    EXPECT_FALSE(fs::exists(folder_ / "search_best.yaml"));
}

TEST_F(HalvingSearch, RunsThatWouldNotGoOnAsTheyWereAreNotPaused) {
    for (auto& planned : runs_) planned.run.settings.push_back({"train.save_replay", "false"});
    EXPECT_THAT(
        test::error_of<ConfigError>([&] { search(); }),
        HasSubstr("mine: with train.save_replay=false a run that pauses does not continue as if it had not"));
    EXPECT_EQ(search(SearchMethod::random), 0);
}

TEST_F(HalvingSearch, RunsThatStoppedWithoutTheirReplayDoNotGoOn) {
    const auto& run = runs_.front().run;
    folder_.write(run.name + "/config.yaml", "train: {save_replay: false}\n");
    folder_.write(run.name + "/episodes.csv", "");
    fs::create_directories(folder_ / run.name / "checkpoints/step_000000100");
    EXPECT_EQ(search(), 1);
    EXPECT_THAT(trained_, IsEmpty());
    EXPECT_THAT(folder_.read("said"),
                HasSubstr("# refused: " + run.name + ": it stopped with train.save_replay=false"));
}

TEST_F(HalvingSearch, NothingIsTrainedWhereARunHasOtherSettings) {
    const auto& run = runs_.front().run;
    folder_.write(run.name + "/config.yaml", "agent: {rate: 7}\n");
    fs::create_directories(folder_ / run.name / "checkpoints/step_000000100");
    EXPECT_EQ(search(), 1);
    EXPECT_THAT(trained_, IsEmpty());
    EXPECT_THAT(folder_.read("said"), HasSubstr("# refused: " + run.name + ": trained with other settings"));
}

TEST_F(HalvingSearch, WithoutAHalvingIsRefused) {
    sweep_.search->first_steps = 400;
    EXPECT_THAT(
        test::error_of<ConfigError>([&] { search(); }),
        HasSubstr("mine: first_steps of 'search:' is 400, and train.total_steps 400, so that nothing would"));
    EXPECT_EQ(search(SearchMethod::random), 0);
}

TEST_F(HalvingSearch, AnOlderResultDoesNotOutliveOneWithoutAWinner) {
    folder_.write("search_best.yaml", "# of fewer samples");
    ends_no_game_ = true;
    EXPECT_EQ(search(), 0);
    EXPECT_FALSE(fs::exists(folder_ / "search_best.yaml"));
}

TEST_F(HalvingSearch, RunsThatReadOtherSettingsAreNotCompared) {
    sweep_.search->first_steps = 100;
    fails_ = 1;
    folder_.write(runs_.front().run.name + "/metadata.json", "{}");
    folder_.write(runs_.front().run.name + "/config.yaml", "agent: {rate: 7}\n");  // of sample 1
    EXPECT_EQ(search(), 1);
    EXPECT_THAT(trained_, ElementsAre("100: 1 2 3 4 5"));
    EXPECT_THAT(folder_.read("said"),
                HasSubstr(": its program read other settings than the sweep: agent.rate"));
}

TEST_F(HalvingSearch, RunsOfDifferentLengthsAreNotCompared) {
    runs_.back().end.total_steps = 500;
    EXPECT_THAT(test::error_of<ConfigError>([&] { search(); }),
                HasSubstr("a search compares runs of the same length, and train.total_steps is 400 and 500"));
}

}  // namespace
}  // namespace cale
