#include "settings/command_line.h"

#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/games.h"
#include "support/temporary_folder.h"
#include "support/working_folder.h"

namespace cale {
namespace {

using test::TemporaryFolder;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

struct RunLength {
    std::int64_t total_steps = 100;
    std::int64_t seed = 1;
};

template <class Visit>
void fields(RunLength& config, Visit&& visit) {
    visit("total_steps", config.total_steps, Range{1, 1e9}, "agent steps");
    visit("seed", config.seed, Range{0, 4294967295.0},
          "what everything random follows from, told in a sentence that is long enough to be wrapped");
}

class CommandLineTest : public ::testing::Test {
  protected:
    CommandLineTest() {
        table_.add("env", env_);
        table_.add("train", train_);
    }

    CommandLine parse(std::vector<std::string> arguments) { return parse(table_, std::move(arguments)); }
    CommandLine parse(ConfigTable& table, std::vector<std::string> arguments) {
        std::vector<const char*> argv{"train_x"};
        for (const auto& argument : arguments) argv.push_back(argument.c_str());
        out_.str("");
        return parse_command_line("train_x", "learns X", table, static_cast<int>(argv.size()), argv.data(),
                                  out_);
    }
    std::string error(std::vector<std::string> arguments) {
        return test::error_of<ConfigError>([&] { parse(std::move(arguments)); });
    }

    EnvConfig env_;
    RunLength train_;
    ConfigTable table_;
    std::ostringstream out_;
    TemporaryFolder folder_;
};

TEST_F(CommandLineTest, NothingGivenMeansDefaults) {
    const auto line = parse({});
    EXPECT_EQ(line.config_file, "");
    EXPECT_EQ(line.run_dir, "");
    EXPECT_EQ(line.device, "auto");
    EXPECT_EQ(line.threads, "auto");
    EXPECT_FALSE(line.resume);
    EXPECT_TRUE(line.progress);
    EXPECT_FALSE(line.finished);
    EXPECT_EQ(out_.str(), "");
    EXPECT_EQ(env_.game, EnvConfig{}.game);
}

TEST_F(CommandLineTest, EveryOption) {
    const auto line =
        parse({"--run-dir", "runs/a", "--device", "cuda:1", "--threads=3", "--no-progress", "--resume",
               "--seed", "7", "--env-id", "ALE/Breakout-v5", "--total-timesteps", "1e6", "--num-envs", "2"});
    EXPECT_EQ(line.run_dir, "runs/a");
    EXPECT_EQ(line.device, "cuda:1");
    EXPECT_EQ(line.threads, "3");
    EXPECT_FALSE(line.progress);
    EXPECT_TRUE(line.resume);
    EXPECT_EQ(train_.seed, 7);
    EXPECT_EQ(env_.game, "ALE/Breakout-v5");
    EXPECT_EQ(train_.total_steps, 1'000'000);
    EXPECT_EQ(env_.num_envs, 2);
}

TEST_F(CommandLineTest, LaterSourcesHaveTheLastWord) {
    const auto file =
        folder_
            .write("x.yaml", "env:\n  num_envs: 2\n  threshold: 0.25\n  frame_skip: 5\ntrain:\n  seed: 2\n")
            .string();
    parse({"--num-envs", "4", "env.num_envs=3", "--set", "env.threshold=0.75", "--config", file, "--seed",
           "9"});
    EXPECT_EQ(env_.frame_skip, 5);    // the file before the defaults
    EXPECT_EQ(env_.threshold, 0.75);  // --set before the file
    EXPECT_EQ(env_.num_envs, 4);      // the option before KEY=VALUE, wherever it stands
    EXPECT_EQ(train_.seed, 9);
    EXPECT_EQ(train_.total_steps, 100);
}

TEST_F(CommandLineTest, IdsThatEndWithV4AreWithoutStickyActions) {
    const auto file = folder_.write("x.yaml", "env:\n  sticky_probability: 0.5\n").string();
    parse({"--env-id", "PongNoFrameskip-v4", "--config", file});
    EXPECT_EQ(env_.sticky_probability, 0);
    EXPECT_EQ(find_game(env_.game).name, "Pong");
    parse({"--env-id", "PongNoFrameskip-v4", "env.sticky_probability=0.125"});
    EXPECT_EQ(env_.sticky_probability, 0.125) << "what is said of the key itself is stronger";
    parse({"--env-id", "ALE/Pong-v5", "--config", file});
    EXPECT_EQ(env_.sticky_probability, 0.5);
    parse({"env.game=PongNoFrameskip-v4", "--config", file});
    EXPECT_EQ(env_.sticky_probability, 0.5) << "as a value of env.game it is a name alone";
}

TEST_F(CommandLineTest, OverridesRepeat) {
    const auto line = parse({"--set", "env.threshold=0.1", "--set=env.frame_skip=2", "--set",
                             "env.threshold=0.2", "env.noop_max=30"});
    EXPECT_EQ(env_.threshold, 0.2);
    EXPECT_EQ(env_.frame_skip, 2);
    EXPECT_EQ(env_.noop_max, 30);
    EXPECT_THAT(line.overrides,
                ElementsAre("env.threshold=0.1", "env.frame_skip=2", "env.threshold=0.2", "env.noop_max=30"));
    parse({"env.threshold=0.3", "--set", "env.threshold=0.2"});
    EXPECT_EQ(env_.threshold, 0.3) << "a plain KEY=VALUE comes after all of --set";
}

TEST_F(CommandLineTest, TheLastOfARepeatedOptionCounts) {
    parse({"--seed", "3", "--seed", "4"});
    EXPECT_EQ(train_.seed, 4);
}

TEST_F(CommandLineTest, ResumeTakesTheRunsOwnConfiguration) {
    folder_.write("config.yaml", "env:\n  threshold: 0.125\n");
    const auto run_dir = folder_.path().string();
    const auto line = parse({"--resume", "--run-dir", run_dir, "env.noop_max=3"});
    EXPECT_EQ(line.config_file, (folder_ / "config.yaml").string());
    EXPECT_EQ(env_.threshold, 0.125);
    EXPECT_EQ(env_.noop_max, 3);

    const auto other = folder_.write("other.yaml", "env:\n  threshold: 0.375\n").string();
    parse({"--resume", "--run-dir", run_dir, "--config", other});
    EXPECT_EQ(env_.threshold, 0.375);

    parse({"--run-dir", run_dir});
    EXPECT_EQ(env_.threshold, 0.375);  // without --resume the folder is not looked at
    EXPECT_EQ(parse({"--resume", "--run-dir", (folder_ / "nothing").string()}).config_file, "");
}

TEST_F(CommandLineTest, ARunOfAnotherAgentIsNamedAsSuch) {
    folder_.write("config.yaml", "agent:\n  atoms: 51\n");
    folder_.write("metadata.json", R"({"program": "train_y"})");
    const auto run_dir = folder_.path().string();
    EXPECT_EQ(error({"--resume", "--run-dir", run_dir}),
              "--resume --run-dir " + run_dir + ": this is a run of train_y; resume it with that program");
    folder_.write("config.yaml", "env:\n  threshold: 0.125\n");
    for (const auto* damaged : {"", "[]", R"({"program": 3})", R"({"program": "train_x"})"}) {
        folder_.write("metadata.json", damaged);
        parse({"--resume", "--run-dir", run_dir});
    }
}

TEST_F(CommandLineTest, AConfigurationOfAnotherAgentIsNamedAsSuch) {
    const auto of_der =
        folder_.write("x.yaml", "agent:\n  num_atoms: 51\n  dueling: true\n  noisy: true\n").string();
    EXPECT_THAT(error({"--config", of_der}), EndsWith("; this is a configuration of train_der"));
    const auto of_nobody = folder_.write("y.yaml", "agent:\n  num_atoms: 51\n  tau: 0.1\n").string();
    EXPECT_THAT(error({"--config", of_nobody}), Not(HasSubstr("this is a configuration")));
}

TEST_F(CommandLineTest, MistakesAreOneSentence) {
    EXPECT_EQ(error({"--no-progress=3"}), "--no-progress takes no value (see train_x --help)");
    EXPECT_EQ(error({"--resume=yes", "--run-dir", "x"}), "--resume takes no value (see train_x --help)");
    EXPECT_EQ(error({"--run-dir", ""}), "--run-dir: needs a value that is not empty (see train_x --help)");
    EXPECT_EQ(error({"--run-dir=", "train.seed=2"}),
              "--run-dir: needs a value that is not empty (see train_x --help)");
    EXPECT_EQ(error({"--run-dir=~/x"}),
              "--run-dir=~/x: a shell replaces ~ only at the start of a word: write --run-dir ~/x "
              "(see train_x --help)");
    EXPECT_THAT(error({"--config", "a.yaml", "--config", "b.yaml"}), HasSubstr("more than once"));
    EXPECT_EQ(error({"--sede", "3"}), "unknown option '--sede'; did you mean '--seed'? (see train_x --help)");
    EXPECT_EQ(error({"--trehsold=3"}), "unknown option '--trehsold' (see train_x --help)");
    EXPECT_EQ(error({"--train.total_steps=3"}),
              "unknown option '--train.total_steps'; settings are given as KEY=VALUE: train.total_steps=" +
                  std::to_string(train_.total_steps) + " (see train_x --help)");
    EXPECT_THAT(error({"--total-steps", "3"}), HasSubstr("given as KEY=VALUE: train.total_steps="));
    EXPECT_EQ(error({"-x"}), "unknown option '-x' (see train_x --help)");
    EXPECT_EQ(error({"--seed"}), "--seed needs a value (see train_x --help)");
    EXPECT_EQ(error({"--run-dir", "--resume"}),
              "--run-dir: '--resume' is an option, not a value (see train_x --help)");
    EXPECT_EQ(error({"pong"}),
              "unexpected argument 'pong'; settings are given as KEY=VALUE (see train_x --help)");
    EXPECT_EQ(error({"--resume"}),
              "--resume needs --run-dir DIR, the folder of the run to continue (see train_x --help)");
    EXPECT_EQ(error({"--seed", "-1"}), "--seed -1: train.seed must be 0 to 4294967295, not '-1'");
    EXPECT_EQ(error({"--seed", "x"}), "--seed x: train.seed must be an integer, not 'x'");
    EXPECT_EQ(error({"--num-envs", "0"}), "--num-envs 0: env.num_envs must be 1 to 1024, not '0'");
    EXPECT_EQ(error({"env.gaem=pong"}),
              "--set env.gaem=pong: unknown key 'env.gaem'; did you mean 'env.game'?");
    EXPECT_EQ(error({"env.sticky_actions=0"}),
              "--set env.sticky_actions=0: unknown key 'env.sticky_actions'; did you mean "
              "'env.sticky_probability'?");
    EXPECT_THAT(error({"--repeat-action-probability=0"}),
                HasSubstr("settings are given as KEY=VALUE: env.sticky_probability="));
    EXPECT_EQ(error({"--config", (folder_ / "no.yaml").string()}),
              "cannot read '" + (folder_ / "no.yaml").string() + "': No such file or directory");
}

TEST_F(CommandLineTest, PresetsOfTheProgramAreNamedInOtherFolders) {
    const test::WorkingFolder elsewhere(folder_.path());
    EXPECT_EQ(error({"--config", "configs/sac/atari100k.yaml"}),
              "cannot read 'configs/sac/atari100k.yaml': No such file or directory; did you mean "
              "'" CALE_SOURCE_DIR "/configs/sac/atari100k.yaml'?");
    EXPECT_EQ(error({"--config", "atari100k.yaml"}),
              "cannot read 'atari100k.yaml': No such file or directory");
}

TEST_F(CommandLineTest, Devices) {
    for (const char* device : {"auto", "cpu", "cuda", "cuda:0", "cuda:12"})
        EXPECT_EQ(parse({"--device", device}).device, device);
    for (const std::string device : {"", "gpu", "cuda:", "cuda:x", "cuda:-1", "cpu:0", "CUDA"}) {
        EXPECT_EQ(error({"--device=" + device}).substr(0, 8), "--device") << device;
    }
    EXPECT_EQ(error({"--device", "gpu"}),
              "--device must be auto, cpu, cuda or cuda:<index>, not 'gpu' (see train_x --help)");
}

TEST_F(CommandLineTest, DevicesThatAreNotThere) {
    const auto refused = [](const std::string& wish, std::uint64_t gpus) {
        return test::error_of<ConfigError>([&] { find_device(wish, gpus); });
    };
    EXPECT_EQ(refused("foo", 2), "--device must be auto, cpu, cuda or cuda:<index>, not 'foo'");
    EXPECT_THAT(refused("cuda", 0), StartsWith("--device cuda: this LibTorch finds no CUDA device; "));
    EXPECT_THAT(refused("cuda:0", 0), StartsWith("--device cuda:0: this LibTorch finds no CUDA device; "));
    EXPECT_EQ(refused("cuda:2", 2),
              "--device cuda:2: cuda:2 is not there; this machine has 2, counted from 0");
    EXPECT_THAT(refused("cuda:99999999999", 1), StartsWith("--device cuda:99999999999: "));
}

TEST_F(CommandLineTest, DevicesThatAreThere) {
    EXPECT_EQ(find_device("cpu", 2).str(), "cpu");
    EXPECT_EQ(find_device("auto", 0).str(), "cpu");
    EXPECT_EQ(find_device("auto", 2).str(), "cuda");
    EXPECT_EQ(find_device("auto", 2, 1).str(), "cuda:1");
    EXPECT_EQ(find_device("cuda", 2).str(), "cuda");
    EXPECT_EQ(find_device("cuda:0", 2, 1).str(), "cuda:0");
}

TEST_F(CommandLineTest, Threads) {
    for (const char* threads : {"auto", "1", "64"}) EXPECT_EQ(parse({"--threads", threads}).threads, threads);
    for (const std::string threads : {"0", "-1", "1.5", "many", "99999"}) {
        EXPECT_EQ(
            error({"--threads=" + threads}),
            "--threads must be auto or a number from 1 to 4096, not '" + threads + "' (see train_x --help)");
    }
}

TEST_F(CommandLineTest, VersionNamesAllThree) {
    EXPECT_TRUE(parse({"--version"}).finished);
    EXPECT_THAT(out_.str(), ::testing::MatchesRegex(
                                "train_x [0-9]+\\.[0-9]+\\.[0-9]+ "
                                "\\(LibTorch [0-9]+\\.[0-9]+\\.[0-9]+.*, ALE [0-9]+\\.[0-9]+\\.[0-9]+\\)\n"));
}

TEST_F(CommandLineTest, PrintsTheResolvedConfiguration) {
    EXPECT_TRUE(parse({"--print-config", "env.threshold=0.125", "--seed", "5"}).finished);
    EXPECT_EQ(out_.str(), table_.to_yaml());
    EXPECT_THAT(out_.str(), HasSubstr("\n  threshold: 0.125\n"));
    EXPECT_THAT(out_.str(), HasSubstr("\n  seed: 5\n"));
}

TEST_F(CommandLineTest, PrintsTheConfigurationOfARunWhereThereIsOne) {
    EXPECT_EQ(error({"--resume", "--run-dir", "/nowhere", "--print-config"}),
              "--resume --run-dir /nowhere: there is no /nowhere/config.yaml");
}

TEST_F(CommandLineTest, PrintsSeveralConfigurationsEachFromTheSameDefaults) {
    const auto printed = [&](const std::vector<std::string>& arguments) {
        table_.reset();
        parse(arguments);
        return out_.str();
    };
    const auto first = printed({"--print-config", "--set", "train.seed=9", "env.threshold=0.125"});
    const auto second = printed({"--print-config", "--set", "train.seed=9", "env.game=breakout"});
    EXPECT_EQ(printed({"--print-config", "--set", "train.seed=9", "env.threshold=0.125", "--or",
                       "env.game=breakout"}),
              first + "---\n" + second);
    EXPECT_EQ(error({"--print-config", "env.threshold=0.25", "--or", "env.threshold=2"}),
              "--set env.threshold=2: env.threshold must be 0 to 1, not '2'");
    EXPECT_THAT(out_.str(), HasSubstr("threshold: 0.25")) << "so it is the second one that is wrong";
    EXPECT_EQ(error({"env.threshold=1", "--or", "env.threshold=0"}),
              "--or is for --print-config (see train_x --help)");
    EXPECT_EQ(error({"--config", "/dev/null", "--print-config", "--or", "env.threshold=0"}),
              "--or reads --config /dev/null again, which is no regular file; give it a file (see train_x "
              "--help)");
}

TEST_F(CommandLineTest, SettingsThatDoNotFitTogetherAreRefused) {
    table_.add_rule([this] {
        if (env_.threshold > 0.5 && env_.num_envs > 1)
            throw std::invalid_argument("env.threshold is above 0.5, which is for env.num_envs = 1");
    });
    parse({"env.threshold=0.75"});
    parse({"env.threshold=0.25", "env.num_envs=2"});
    const std::string sentence = "env.threshold is above 0.5, which is for env.num_envs = 1";
    EXPECT_EQ(error({"env.threshold=0.75", "env.num_envs=2"}), sentence);
    EXPECT_EQ(error({"--print-config", "--num-envs", "2", "env.threshold=0.75"}), sentence);
    EXPECT_EQ(out_.str(), "");
}

TEST_F(CommandLineTest, HelpListsEveryKeyOfTheTable) {
    for (const char* flag : {"--help", "-h"}) {
        EXPECT_TRUE(parse({flag}).finished);
        EXPECT_THAT(out_.str(), StartsWith("train_x: learns X\n"));
    }
    const auto help = help_text("train_x", "learns X", table_, 1000);
    for (const auto& entry : table_.entries()) {
        EXPECT_THAT(help, HasSubstr("\n  " + entry.key));
        EXPECT_THAT(help, HasSubstr(entry.help + " [" + entry.type));
    }
    EXPECT_THAT(help, HasSubstr("tau: how far the joystick must be pushed to count, as a part of its radius "
                                "[number, 0 to 1, default 0.5]\n"));
    EXPECT_THAT(help, HasSubstr("\nenv\n  env.game"));
    EXPECT_THAT(help, HasSubstr("\ntrain\n  train.total_steps"));
}

TEST_F(CommandLineTest, HelpKeepsToItsWidth) {
    for (const std::size_t width : {60u, 80u, 120u}) {
        std::istringstream lines(help_text("train_x", "learns X", table_, width));
        std::size_t longest = 0;
        for (std::string text; std::getline(lines, text);) longest = std::max(longest, text.size());
        EXPECT_LE(longest, width);
        EXPECT_GT(longest, width - 15);
    }
}

TEST_F(CommandLineTest, HelpAndVersionDoNotReadTheConfiguration) {
    EXPECT_TRUE(parse({"--help", "--config", "/no/such/file.yaml"}).finished);
}

TEST_F(CommandLineTest, ShortcutsAreOfferedWhereTheirKeyExists) {
    RunLength train;
    ConfigTable table;
    table.add("train", train);
    EXPECT_THAT(help_text("train_x", "learns X", table, 80), Not(HasSubstr("--num-envs")));
    EXPECT_THAT(help_text("train_x", "learns X", table_, 80), HasSubstr("--num-envs N"));
    EXPECT_EQ(test::error_of<ConfigError>([&] {
                  parse(table, {"--num-envs", "2"});
              }),
              "unknown option '--num-envs' (see train_x --help)");
}

}  // namespace
}  // namespace cale
