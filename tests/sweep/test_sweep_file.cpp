// Sweep files: which runs they stand for, and what is said of mistakes.
#include "sweep/sweep_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "settings/config.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class SweepFile : public testing::Test {
  protected:
    Sweep read(const std::string& text, const std::vector<std::string>& overrides = {}) {
        return read_sweep(folder_.write("mine.yaml", text), overrides);
    }
    std::vector<std::string> names(const std::string& text, const std::vector<std::string>& overrides = {}) {
        std::vector<std::string> result;
        for (const auto& run : read(text, overrides).runs) result.push_back(run.name);
        return result;
    }
    std::string mistake(const std::string& text, const std::vector<std::string>& overrides = {}) {
        return test::error_of<ConfigError>([&] { read(text, overrides); });
    }

    test::TemporaryFolder folder_;
    const std::string small_ = "agent: sac\ngrid:\n  env.game: pong\n  train.seed: 1..2\n";
};

std::string value_of(const SweepRun& run, const std::string& key) {
    const auto found = std::find_if(run.settings.begin(), run.settings.end(),
                                    [&](const Setting& setting) { return setting.key == key; });
    return found == run.settings.end() ? "" : found->value;
}

TEST_F(SweepFile, IsEveryCombinationTheFirstKeyOutermost) {
    EXPECT_THAT(names("agent: sac\n"
                      "grid:\n"
                      "  train.seed: 1..2\n"
                      "  env.game: [pong, ALE/MsPacman-v5]\n"
                      "  agent.encoder: [phi_sac, phi_dqn]\n"),
                ElementsAre("Pong__sac__encoder=phi_sac__1", "Pong__sac__encoder=phi_dqn__1",
                            "MsPacman__sac__encoder=phi_sac__1", "MsPacman__sac__encoder=phi_dqn__1",
                            "Pong__sac__encoder=phi_sac__2", "Pong__sac__encoder=phi_dqn__2",
                            "MsPacman__sac__encoder=phi_sac__2", "MsPacman__sac__encoder=phi_dqn__2"));
}

TEST_F(SweepFile, ASecondDocumentIsRefused) {
    EXPECT_THAT(mistake(small_ + "---\nset: {agent.gamma: 1}\n"),
                HasSubstr("mine.yaml:5:1: a second YAML document"));
}

TEST_F(SweepFile, ARangeMayEndAtTheLargestNumber) {
    EXPECT_THAT(
        names(
            "agent: sac\ngrid:\n  env.game: pong\n  train.seed: 9223372036854775806..9223372036854775807\n"),
        ElementsAre("Pong__sac__9223372036854775806", "Pong__sac__9223372036854775807"));
}

TEST_F(SweepFile, VariantsAreGridsOfTheirOwn) {
    EXPECT_THAT(
        names("grid:\n"
              "  train.seed: [1, 7]\n"
              "  env.game: pong\n"
              "variants:\n"
              "  - agent: sac\n"
              "    agent.encoder: [phi_sac, phi_dqn]\n"
              "  - agent: dqn\n"),
        ElementsAre("Pong__sac__encoder=phi_sac__1", "Pong__sac__encoder=phi_dqn__1", "Pong__dqn__1",
                    "Pong__sac__encoder=phi_sac__7", "Pong__sac__encoder=phi_dqn__7", "Pong__dqn__7"));
}

TEST_F(SweepFile, SetGoesToAllRunsAndTheGridGoesBefore) {
    const auto sweep = read(
        "agent: sac\n"
        "set:\n"
        "  train.total_steps: 1e5\n"
        "  env.threshold: 0.9\n"
        "grid: {train.seed: 3, env.game: ms_pacman, env.threshold: [0.1, 0.5]}\n");
    ASSERT_EQ(sweep.runs.size(), 2u);
    EXPECT_EQ(sweep.name, "mine");
    EXPECT_EQ(sweep.runs[1].game, "MsPacman");
    EXPECT_THAT(sweep.runs[1].settings,
                ElementsAre(Setting{"train.total_steps", "1e5"}, Setting{"train.seed", "3"},
                            Setting{"env.game", "ms_pacman"}, Setting{"env.threshold", "0.5"}));
}

TEST_F(SweepFile, ConfigurationsAreRelativeToTheFileAndMayNameTheAgent) {
    const auto sweep = read(
        "config: ../configs/{agent}/200m.yaml\n"
        "grid: {train.seed: 1, env.game: pong, agent: [ppo, der]}\n");
    EXPECT_EQ(sweep.runs[0].config, folder_.path().parent_path() / "configs/ppo/200m.yaml");
    EXPECT_EQ(sweep.runs[1].config, folder_.path().parent_path() / "configs/der/200m.yaml");
    EXPECT_EQ(sweep.runs[1].agent, "der");
    const auto twice =
        read("config: ../{agent}/{agent}.yaml\nagent: sac\ngrid: {train.seed: 1, env.game: pong}\n");
    EXPECT_EQ(twice.runs[0].config, folder_.path().parent_path() / "sac/sac.yaml");
}

TEST_F(SweepFile, RangesHaveTheirWholeNumbers) {
    EXPECT_THAT(names("agent: sac\ngrid: {train.seed: 1_000..1_002, env.game: pong}\n"),
                ElementsAre("Pong__sac__1000", "Pong__sac__1001", "Pong__sac__1002"));
}

TEST_F(SweepFile, AValueThatIsWrittenInTwoWaysIsOne) {
    EXPECT_THAT(
        names("agent: sac\n"
              "grid: {train.seed: [1, 01, 1e0], env.game: pong, agent.learning_rate: [1e-4, 0.0001]}\n"),
        ElementsAre("Pong__sac__learning_rate=1e-4__1"));
}

TEST_F(SweepFile, GroupsOfGamesAreTheirGamesOnceEach) {
    const auto games = [&](const std::string& value) {
        std::set<std::string> result;
        const auto runs = read("agent: sac\ngrid: {train.seed: 1, env.game: " + value + "}").runs;
        for (const auto& run : runs) result.insert(run.game);
        EXPECT_EQ(result.size(), runs.size()) << value;
        return result;
    };
    EXPECT_EQ(games("all").size(), 60u);
    EXPECT_EQ(games("atari100k").size(), 26u);
    EXPECT_EQ(games("paper_ten").size(), 10u);
    EXPECT_TRUE(games("paper_ten").contains("Centipede"));
    EXPECT_EQ(games("[atari100k, Pong, Tennis]").size(), 27u);
}

TEST_F(SweepFile, TheCommandLineReplacesValuesAndAddsKeys) {
    EXPECT_THAT(names(small_, {"env.game=breakout,pong", "train.seed=5", "agent.encoder=phi_sac,impala"}),
                ElementsAre("Breakout__sac__encoder=phi_sac__5", "Breakout__sac__encoder=impala__5",
                            "Pong__sac__encoder=phi_sac__5", "Pong__sac__encoder=impala__5"));
    const auto sweep =
        read(small_ + "set: {train.total_steps: 9}\n", {"train.total_steps=70", "log.every=8"});
    EXPECT_EQ(sweep.runs[0].name, "Pong__sac__1") << "one value is no difference between the runs";
    EXPECT_EQ(value_of(sweep.runs[0], "train.total_steps"), "70");
    EXPECT_EQ(value_of(sweep.runs[0], "log.every"), "8");
    EXPECT_EQ(read(small_, {"config=mine.yaml"}).runs[0].config, std::filesystem::absolute("mine.yaml"));
}

TEST_F(SweepFile, TheCommandLineReplacesValuesOfSetBesideThoseOfVariants) {
    const std::string text =
        "set: {env.game: pong, train.seed: 1, agent.gamma: 0.9}\n"
        "variants: [{agent: sac, agent.gamma: 0.95}, {agent: dqn}]\n";
    const auto gammas = [&](const std::string& override_) {
        std::vector<std::string> result;
        for (const auto& run : read(text, {override_}).runs)
            for (const auto& [key, value] : run.settings)
                if (key == "agent.gamma") result.push_back(run.agent + " " + value);
        return result;
    };
    EXPECT_THAT(gammas("agent.gamma=0.5"), ElementsAre("sac 0.5", "dqn 0.5"));
    EXPECT_THAT(gammas("agent.gamma=0.5,0.6"), ElementsAre("sac 0.5", "sac 0.6", "dqn 0.5", "dqn 0.6"));
}

TEST_F(SweepFile, TheCommandLineHoldsForVariantsWithoutTheKey) {
    const std::string text =
        "set: {env.game: pong, train.seed: 1}\n"
        "variants: [{agent: sac, agent.gamma: [0.9, 0.95]}, {agent: dqn}]\n";
    const auto gammas = [&](const std::string& override_) {
        std::vector<std::string> result;
        for (const auto& run : read(text, {override_}).runs)
            result.push_back(run.name + " " + value_of(run, "agent.gamma"));
        return result;
    };
    EXPECT_THAT(gammas("agent.gamma=0.5"), ElementsAre("Pong__sac__gamma=0.5__1 0.5", "Pong__dqn__1 0.5"));
    EXPECT_THAT(gammas("agent.gamma=0.5,0.6"),
                ElementsAre("Pong__sac__gamma=0.5__1 0.5", "Pong__sac__gamma=0.6__1 0.6",
                            "Pong__dqn__gamma=0.5__1 0.5", "Pong__dqn__gamma=0.6__1 0.6"));
}

TEST_F(SweepFile, AMissingValueOfTheCommandLineIsNamed) {
    for (const auto* text : {"train.seed=1,", "train.seed=", "agent=", "agent.gamma=0.9,,0.99"})
        EXPECT_EQ(mistake(small_, {text}), std::string(text) + ": a value is missing");
}

TEST_F(SweepFile, ConfigurationsBehindLinksAreFound) {
    namespace fs = std::filesystem;
    fs::create_directories(folder_ / "deep/sweeps");
    folder_.write("deep/sweeps/mine.yaml",
                  "config: ../sac.yaml\nset: {agent: sac, env.game: pong, train.seed: 1}\n");
    fs::create_directory_symlink(folder_ / "deep/sweeps", folder_ / "link");
    EXPECT_EQ(read_sweep(folder_ / "link/mine.yaml", {}).runs.front().config,
              fs::canonical(folder_ / "deep") / "sac.yaml");
}

TEST_F(SweepFile, RemembersWhereItHasItsSettings) {
    const auto places = read(small_ + "set:\n  env.threshold: 0.9\n  log.every: 5\n", {"log.every=5"}).places;
    const auto file = (folder_ / "mine.yaml").string();
    EXPECT_EQ(places.at("env.game=pong"), file + ":3:3");
    EXPECT_EQ(places.at("train.seed=2"), file + ":4:3");
    EXPECT_EQ(places.at("env.threshold=0.9"), file + ":6:3");
    EXPECT_FALSE(places.contains("log.every=5")) << "it is the command line's";
}

TEST_F(SweepFile, VariantsThatMeetAreOneRun) {
    const std::string both =
        "grid: {env.game: pong, train.seed: 1}\n"
        "variants:\n"
        "  - {agent: sac, agent.encoder: [phi_sac, phi_dqn]}\n"
        "  - {agent: sac, agent.encoder: [phi_dqn, impala]}\n";
    EXPECT_EQ(names(both).size(), 3u);
    EXPECT_EQ(read_sweep(folder_ / "mine.yaml", {}).repeated, 1U);
}

TEST_F(SweepFile, KeysOfTheSameNameKeepTheirSections) {
    EXPECT_THAT(names("agent: sac\n"
                      "grid: {train.seed: 1, env.game: pong, env.noop_max: 0, eval.noop_max: 29}\n"),
                ElementsAre("Pong__sac__env.noop_max=0__eval.noop_max=29__1"));
}

TEST_F(SweepFile, NamesAreFoldersWhateverTheValues) {
    EXPECT_THAT(names("agent: sac\n"
                      "grid: {train.seed: 1, env.game: pong, env.rom_dir: '/my roms/*'}\n"),
                ElementsAre("Pong__sac__rom_dir=-my-roms--__1"));
}

TEST_F(SweepFile, ASearchTrainsEverySampleInEveryCombination) {
    const auto text = small_ +
                      "set: {agent.rate: 1}\n"
                      "search:\n"
                      "  samples: 2\n"
                      "  settings:\n"
                      "    agent.rate: log 1e-5..1e-3\n"
                      "    agent.size: [1, 2]\n";
    const auto sweep = read(text);
    ASSERT_EQ(sweep.samples.size(), 2U);
    std::vector<std::string> names;
    for (const auto& run : sweep.runs) {
        names.push_back(run.name);
        const auto& sample = sweep.samples[static_cast<std::size_t>(run.sample) - 1];
        EXPECT_EQ(value_of(run, "agent.rate"), sample[0].value) << "a searched setting goes before 'set'";
        EXPECT_EQ(value_of(run, "agent.size"), sample[1].value);
        EXPECT_EQ(sweep.places.at(assignment(sample[1])).substr(folder_.path().string().size()),
                  "/mine.yaml:10:5");
    }
    EXPECT_THAT(names, ElementsAre("Pong__sac__sample=1__1", "Pong__sac__sample=2__1",
                                   "Pong__sac__sample=1__2", "Pong__sac__sample=2__2"));
    EXPECT_EQ(sweep.runs[0].combination, "Pong__sac__1");
    for (const auto& run : read(text, {"agent.rate=0.5"}).runs) EXPECT_EQ(value_of(run, "agent.rate"), "0.5");
    for (const auto& run : read(text, {"agent.rate=0.5..0.6"}).runs)
        EXPECT_THAT(value_of(run, "agent.rate"), testing::StartsWith("0.5"));
    EXPECT_EQ(read(text, {"agent.rate=log 1..8"}).samples.size(), 2U);
    EXPECT_THAT(mistake(text, {"agent.rate=3..1"}), HasSubstr("agent.rate=3..1: the range 3..1 is empty"));
    EXPECT_EQ(read(small_).search, std::nullopt);
}

TEST_F(SweepFile, MistakesInASearchSayWhere) {
    const auto search = [&](const std::string& text) { return mistake(small_ + "search: {" + text + "}\n"); };
    EXPECT_THAT(search("samples: 3"), HasSubstr("mine.yaml:5:9: 'search' lacks 'settings:'"));
    EXPECT_THAT(search("settings: {agent.size: 1..3}"), HasSubstr("'search' lacks 'samples:'"));
    EXPECT_THAT(search("sample: 3"),
                HasSubstr("mine.yaml:5:10: unknown key 'sample'; did you mean 'samples'?"));
    EXPECT_THAT(search("samples: 0"), HasSubstr("expected an integer, 1 to 10000, not '0'"));
    const auto settings = [&](const std::string& text) {
        return search("samples: 3, settings: {" + text + "}");
    };
    EXPECT_THAT(settings("agent.size: 5"),
                HasSubstr("'5' is no range; expected settings and what they are drawn from"));
    EXPECT_THAT(settings("agent.size: 5..1"), HasSubstr("the range 5..1 is empty"));
    EXPECT_THAT(settings("agent.size: log -1..1"), HasSubstr("above 0"));
    EXPECT_THAT(settings("agent.size: []"), HasSubstr("'agent.size' has no values"));
    EXPECT_THAT(settings("agent.size: [1, 2]"),
                HasSubstr("no more than 2 different samples were found, of 3"));
    EXPECT_THAT(settings("agent: [sac, der]"), HasSubstr("'agent' is no key"));
    EXPECT_THAT(settings("train.seed: 1..9"),
                HasSubstr("'train.seed' is not searched: it goes below 'grid:'"));
    EXPECT_THAT(
        mistake(small_ + "  agent.size: [1, 2]\nsearch: {samples: 2, settings: {agent.size: 1..9}}\n"),
        HasSubstr("'agent.size' is in 'grid' and in 'search'; leave it in one of them"));
}

TEST_F(SweepFile, MistakesAreOneSentenceThatSaysWhere) {
    EXPECT_THAT(mistake(small_ + "gird: {}\n"),
                HasSubstr("mine.yaml:5:1: unknown key 'gird'; did you mean 'grid'?"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {game: pong}\n"), HasSubstr("mine.yaml:2:8: 'game' is no key"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pnog}\n"), HasSubstr("mine.yaml:2:18: "));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pnog}\n"), HasSubstr("pong"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: 'pong,krull'}\n"),
                HasSubstr("'pong,krull' is several games, and a run of a sweep is of one;"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {train.seed: 5..1}\n"), HasSubstr("the range 5..1 is empty"));
    for (const std::string range : {"-3..-1", "1e5..3e5", "0.1..0.5"})
        EXPECT_THAT(mistake("agent: sac\ngrid: {agent.number: " + range + "}\n"),
                    HasSubstr("the range " + range + " cannot be counted: only whole numbers from 0 on are"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {train.seed: 0..4000000000}\n"),
                HasSubstr("more than 100000 values"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: all, train.seed: 1..5000}\n"),
                HasSubstr("mine.yaml: more than 100000 runs"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pong, agent.epsilon_eval: null}\n"),
                HasSubstr("mine.yaml:2:44: there is no value; write none"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: []}\n"), HasSubstr("'env.game' has no values"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: {a: b}}\n"), HasSubstr("expected a single word"));
    EXPECT_THAT(mistake("agent: sac\ngrid: 5\n"), HasSubstr("expected keys with their values"));
    EXPECT_THAT(mistake("- a\n"), HasSubstr("mine.yaml:1:1: a sweep file has 'grid:'"));
    EXPECT_THAT(mistake(""), HasSubstr("a sweep file has 'grid:'"));
    EXPECT_THAT(mistake("grid: [\n"), HasSubstr("not valid YAML"));
    EXPECT_THAT(mistake("agent: sac\ngrid:\n  env.game: pong\n  env.game: pong\n"),
                HasSubstr("mine.yaml:4:3: 'env.game' is there a second time; line 3 has the first"));
    EXPECT_THAT(mistake(small_ + "set: {env.threshold: [0.1, 0.2]}\n"),
                HasSubstr("what varies goes below 'grid:'"));
    EXPECT_THAT(mistake(small_ + "variants: {agent: sac}\n"), HasSubstr("'variants' is a list"));
    EXPECT_THAT(mistake(small_ + "variants: [{train.seed: 3}]\n"), HasSubstr("in 'grid' and in 'variants'"));
    EXPECT_THAT(mistake("grid: {env.game: pong, train.seed: 1}\n"), HasSubstr("agent is missing"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {train.seed: 1}\n"), HasSubstr("env.game is missing"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pong}\n"), HasSubstr("train.seed is missing"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pong, train.sed: 1}\n"),
                HasSubstr("train.seed is missing; did you mean it by 'train.sed'?"));
    EXPECT_THAT(mistake(small_ + "set: {agent: der}\n"), HasSubstr("'agent' is there twice"));
    EXPECT_THAT(mistake("agent: [sac, der]\ngrid: {env.game: pong, train.seed: 1}\n"),
                HasSubstr("mine.yaml:1:8: 'agent' has several values: what varies goes below 'grid:'"));
    EXPECT_THAT(
        mistake("env:\n  game: pong\n"),
        HasSubstr("mine.yaml:1:1: 'env' is of a configuration, which a sweep file names by 'config: FILE'"));
    EXPECT_THAT(mistake("agent: 'sac\ngrid: {env.game: pong, train.seed: 1}\n"),
                HasSubstr("mine.yaml:1:8: not valid YAML: a quote is opened here and not closed"));
    EXPECT_THAT(mistake("agent: sac\ngrid: {env.game: pong, train.seed: 1, config: [a/x.yaml, b/x.yaml]}\n"),
                HasSubstr("two different runs would be called Pong__sac__config=x__1"));
    EXPECT_THAT(mistake(small_ + "variants: [{train.run: " + std::string(250, 'x') + "}]\n"),
                HasSubstr("a run's folder would have a name of "));
    EXPECT_THAT(mistake(small_, {"env.game"}), HasSubstr("expected KEY=VALUE"));
    EXPECT_THAT(mistake(small_, {"game=pong"}), HasSubstr("'game' is no key"));
    EXPECT_THAT(mistake(small_, {"env.game=pong,pnog"}), HasSubstr("env.game=pong,pnog: "));
    EXPECT_THAT(test::error_of<ConfigError>([&] { read_sweep(folder_ / "none.yaml"); }),
                HasSubstr("none.yaml': No such file or directory; "));
    folder_.write("encoders.yaml", "");
    EXPECT_THAT(test::error_of<ConfigError>([&] { read_sweep(folder_ / "encoder.yaml"); }),
                HasSubstr("did you mean '" + (folder_ / "encoders.yaml").string() + "'?"));
}

TEST_F(SweepFile, ASearchHasASeedAndAFirstHalvingOfItsOwn) {
    const auto search = [&](const std::string& more) {
        return read(small_ + "search: {samples: 2, " + more + "settings: {agent.size: 1..1000000}}\n");
    };
    const auto plain = search(""), other = search("seed: 7, first_steps: 12_500, ");
    EXPECT_EQ(plain.search->seed, 1U);
    EXPECT_EQ(other.search->seed, 7U);
    EXPECT_EQ(other.search->first_steps, 12'500);
    EXPECT_NE(other.samples, plain.samples);
}

}  // namespace
}  // namespace cale
