// train_sac and cale from their command lines to their exit codes.
#include "experiment/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <sys/wait.h>

#include <ATen/Parallel.h>
#include <fmt/format.h>

#include "agents/ppo.h"
#include "agents/sac.h"
#include "cale/games.h"
#include "experiment/files.h"
#include "experiment/run_lock.h"
#include "temporary_folder.h"

namespace cale {
namespace {

using test::TemporaryFolder;

struct Answer {
    int code;
    std::string stderr_text;
};

template <class Config>
Answer train(const std::string& agent, std::unique_ptr<Agent> (*make)(const Config&, const AgentSpec&),
             const std::vector<std::string>& arguments) {
    const auto program = "train_" + agent;
    std::vector<const char*> argv{program.c_str()};
    for (const auto& argument : arguments) argv.push_back(argument.c_str());
    testing::internal::CaptureStderr();
    const int code = run_program<Config>(agent, "Trains.", make, static_cast<int>(argv.size()), argv.data());
    return {code, testing::internal::GetCapturedStderr()};
}

Answer train_sac(const std::vector<std::string>& arguments) {
    return train("sac", make_sac, arguments);
}

/// A run of a few steps with a small network.
std::vector<std::string> small(const std::filesystem::path& run_dir, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--run-dir",
                                          run_dir.string(),
                                          "--threads",
                                          "1",
                                          "--no-progress",
                                          "agent.encoder=phi_dqn",
                                          "agent.hidden_units=8",
                                          "agent.replay_capacity=1000",
                                          "train.total_steps=12",
                                          "eval.episodes=0"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

TEST(ProgramEmulator, TrainsAndWritesWhatItRan) {
    const TemporaryFolder folder;
    const auto answer = train_sac(small(folder.path() / "run", {"env.game=ALE/MsPacman-v5", "--seed", "5"}));
    EXPECT_EQ(answer.code, 0) << answer.stderr_text;
    EXPECT_THAT(read_file(folder.path() / "run" / "config.yaml"), testing::HasSubstr("seed: 5"));
    EXPECT_THAT(read_file(folder.path() / "run" / "metadata.json"), testing::HasSubstr("ALE/MsPacman-v5"));
}

TEST(ProgramEmulator, MistakesAreOneSentenceAndExitCode2) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto wrong = folder.write("roms/pong.bin", "no game").parent_path().string();
    for (const auto& [mistake, said] :
         std::vector<std::pair<std::string, std::string>>{{"env.gmae=pong", "env.game"},
                                                          {"env.game=pongg", "pong"},
                                                          {"env.threshold=1.5", "0 to 1"},
                                                          {"env.rom_dir=/nowhere", "/nowhere"},
                                                          {"env.rom_dir=/m\xfcller", "which is UTF-8"},
                                                          {"env.rom_dir=" + wrong, "with MD5"}}) {
        const auto answer = train_sac(small(run, {mistake}));
        EXPECT_EQ(answer.code, 2) << mistake;
        EXPECT_THAT(answer.stderr_text, testing::HasSubstr(said)) << mistake;
        EXPECT_EQ(std::count(answer.stderr_text.begin(), answer.stderr_text.end(), '\n'), 1)
            << answer.stderr_text;
        EXPECT_FALSE(std::filesystem::exists(run)) << "nothing may be left behind";
    }
    EXPECT_EQ(train_sac({"--device", "tpu"}).code, 2);
}

TEST(ProgramEmulator, OverlapIsForAgentsWithAReplay) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto answer = train("ppo", make_ppo, {"--run-dir", run.string(), "train.overlap=true"});
    EXPECT_EQ(answer.code, 2);
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("train.overlap: ppo learns only from"));
    EXPECT_FALSE(std::filesystem::exists(run));
    EXPECT_EQ(train_sac(small(run, {"train.overlap=true"})).code, 0);
}

TEST(ProgramEmulator, AResumedRunKeepsItsThreads) {
    const TemporaryFolder folder;
    const int before = at::get_num_threads();
    auto arguments = small(folder.path());
    arguments[3] = "2";  // of --threads
    ASSERT_EQ(train_sac(arguments).code, 0);
    at::set_num_threads(1);
    // Without --threads: auto.
    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    EXPECT_EQ(at::get_num_threads(), 2);
    at::set_num_threads(before);
}

TEST(ProgramEmulator, AFolderWithARunIsNotOverwritten) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto again = train_sac(small(folder.path()));
    EXPECT_EQ(again.code, 2);
    EXPECT_THAT(again.stderr_text, testing::HasSubstr("--resume"));
}

TEST(ProgramEmulator, ResumesOnlyTheSameConfiguration) {
    const TemporaryFolder folder;
    EXPECT_EQ(train_sac({"--resume", "--run-dir", (folder.path() / "none").string()}).code, 3);

    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto other =
        train_sac({"--resume", "--run-dir", folder.path().string(), "agent.gamma=0.5", "--no-progress"});
    EXPECT_EQ(other.code, 3);
    EXPECT_THAT(other.stderr_text, testing::HasSubstr("agent.gamma was 0.99 and is now 0.5"));

    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "checkpoints" / "step_000000020"));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 20"));
}

TEST(ProgramEmulator, ResumesAnotherConfigurationOnlyWhenToldTo) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto resume = [&](std::vector<std::string> more) {
        std::vector<std::string> arguments{
            "--resume",        "--run-dir", folder.path().string(), "--no-progress", "train.total_steps=20",
            "--accept-changes"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return train_sac(arguments);
    };
    const auto other_game = resume({"env.game=breakout", "agent.learning_rate=0.5"});
    EXPECT_EQ(other_game.code, 3);
    EXPECT_THAT(other_game.stderr_text, testing::HasSubstr("cannot go on in another environment: env.game"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"),
                testing::Not(testing::HasSubstr("accepted_changes")));

    const auto changed = resume({"agent.learning_rate=0.5"});
    EXPECT_EQ(changed.code, 0) << changed.stderr_text;
    EXPECT_THAT(changed.stderr_text, testing::HasSubstr("changed in mid-run: agent.learning_rate was"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"), testing::HasSubstr("agent.learning_rate was"));
    const auto misfit = resume({"agent.hidden_units=9"});
    EXPECT_EQ(misfit.code, 3) << "another network";
    EXPECT_THAT(misfit.stderr_text,
                testing::HasSubstr("what is stored may not fit agent.hidden_units was 8 and is now 9: "));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("hidden_units: 8"));
    EXPECT_EQ(train_sac(small(folder.path() / "new", {"--accept-changes"})).code, 2);
}

TEST(ProgramEmulator, SettingsThatWereEditedInTheRunsFolderAreAnotherConfiguration) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto config = folder.path() / "config.yaml";
    const auto settings = read_file(config);
    const auto resume = [&](std::vector<std::string> more = {}) {
        std::vector<std::string> arguments{"--resume", "--run-dir", folder.path().string(), "--no-progress",
                                           "train.total_steps=20"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return train_sac(arguments);
    };
    write_file_atomically(config, settings + "\n");  // says the same
    EXPECT_EQ(resume().code, 0);
    auto edited = settings;
    edited.replace(edited.find("gamma: 0.99"), 11, "gamma: 0.5 ");
    for (const auto& text : {edited, std::string()}) {
        write_file_atomically(config, text);
        const auto answer = resume();
        EXPECT_EQ(answer.code, 3);
        EXPECT_THAT(answer.stderr_text, testing::HasSubstr("another configuration: "));
    }
    write_file_atomically(config, settings);
    ASSERT_EQ(resume({"--accept-changes", "agent.learning_rate=0.5"}).code, 0);
    EXPECT_EQ(resume().code, 0) << "accepted once is enough";
}

TEST(ProgramEmulator, ARunCannotBecomeShorterThanItIs) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto shorter =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=5", "--no-progress"});
    EXPECT_EQ(shorter.code, 3);
    EXPECT_THAT(shorter.stderr_text,
                testing::HasSubstr("it is at agent step 12 already, and train.total_steps is 5"));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 12"));
}

TEST(ProgramEmulator, AFolderThatCannotBeMadeIsNamed) {
    const TemporaryFolder folder;
    const auto file = folder.write("file", "");
    const auto answer = train_sac(small(file / "run"));
    EXPECT_EQ(answer.code, 2);
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("--run-dir " + (file / "run").string() +
                                                       ": the folder cannot be made (Not a directory)"));
}

TEST(ProgramEmulator, ARunIsTrainedByOneProcessAtATime) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const RunLock lock(folder.path());
    const auto second = train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20"});
    EXPECT_EQ(second.code, 1);
    EXPECT_THAT(second.stderr_text, testing::HasSubstr("is training in " + folder.path().string()));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 12"));
}

// ---- cale -----------------------------------------------------------------------------

struct Said {
    int code = 0;
    std::string text{};  // on both outputs
};

/// The program `cale`, in `folder`, with a shell's words.
Said cale_says(const std::string& words, const std::filesystem::path& folder = ".") {
    const auto command =
        fmt::format("cd '{}' && {}/cale {} 2>&1 < /dev/null", folder.string(), CALE_BINARY_DIR, words);
    std::FILE* const pipe = ::popen(command.c_str(), "r");
    Said said;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said.text.push_back(static_cast<char>(c));
    said.code = WEXITSTATUS(::pclose(pipe));
    return said;
}

TEST(CaleProgram, MistakesAreOneSentenceAndExitCode2) {
    for (
        const auto& [words, sentence] : std::vector<std::pair<std::string, std::string>>{
            {"evalute", "cale: unknown command 'evalute'; did you mean 'evaluate'?"},
            {"nosuch", "cale: unknown command 'nosuch'; cale --help lists them"},
            {"--verson", "cale: unknown option '--verson'; did you mean '--version'? (see cale --help)"},
            {"evaluate", "cale evaluate: POLICY is missing (see cale evaluate --help)"},
            {"evaluate --frobnicate",
             "cale evaluate: unknown option '--frobnicate' (see cale evaluate --help)"},
            {"evaluate x --epislon=0",
             "cale evaluate: unknown option '--epislon'; did you mean '--epsilon'? (see cale evaluate "
             "--help)"},
            {"evaluate x env.game=pong",
             "cale evaluate: unexpected argument 'env.game=pong'; settings are given as --set KEY=VALUE (see "
             "cale evaluate --help)"},
            {"evaluate x --seed", "cale evaluate: --seed needs a value (see cale evaluate --help)"},
            {"evaluate x --seed 1 --seed 2",
             "cale evaluate: --seed is given more than once (see cale evaluate --help)"},
            {"evaluate x --video=maybe", "cale evaluate: --video takes no value (see cale evaluate --help)"},
            {"evaluate x --greedy --sampled", "cale evaluate: --greedy excludes --sampled: give one of them"},
            {"evaluate x --protocol fixed_step",
             "cale evaluate: --protocol is 'fixed_step': give fixed_episodes or fixed_steps; did you mean "
             "'fixed_steps'?"},
            {"evaluate x --out ''", "cale evaluate: --out is '': give DIR, or leave it out"},
            {"evaluate x --out --video", "cale evaluate: --out is '--video': give DIR, or leave it out"},
            {"map -o ''", "cale map: --output is '': give FILE, or leave it out"},
            {"evaluate x --video-episode 3",
             "cale evaluate: --video-episode requires --video: give both, or neither"},
            {"report x --baselines-file y",
             "cale report: --baselines-file requires --baselines: give both, or neither"},
            {"evaluate x --device foo",
             "cale evaluate: --device must be auto, cpu, cuda or cuda:<index>, not 'foo'"},
            {"play", "cale play: give a GAME, a --policy FILE, or both"},
            {"map -o .", "cale map: --output .: that is a folder; give the name of a file"},
            {"export x -o /nowhere/x",
             "cale export: --output /nowhere/x: there is no folder '/nowhere'; make it, or give another"}}) {
        const auto said = cale_says(words);
        EXPECT_EQ(said.text, sentence + "\n");
        EXPECT_EQ(said.code, 2) << words;
    }
}

TEST(CaleProgram, NumbersAreAllThatIsWritten) {
    const std::string whole = "give a whole number from ", any = "give a number from ";
    for (const auto& [words, way_out] : std::vector<std::pair<std::string, std::string>>{
             {"evaluate x --episodes x", whole + "1 to 1000000"},
             {"evaluate x --episodes 2.5", whole + "1 to 1000000"},
             {"evaluate x --seed -1", whole + "0 to 4294967295"},
             {"evaluate x --seed 99999999999999999999", whole},
             {"evaluate x --epsilon nan", any + "0 to 1"},
             {"evaluate x --epsilon 2", any + "0 to 1"},
             {"evaluate x --video --video-minutes nan", any},
             {"map --threshold nan", any + "0 to 1"},
             {"play pong --speed nan", any + "0 to 100"},
             {"play pong --seed -5", whole}}) {
        const auto said = cale_says(words);
        const auto value = words.substr(words.rfind(' ') + 1);
        EXPECT_THAT(said.text, testing::HasSubstr(" is '" + value + "': " + way_out)) << words;
        EXPECT_EQ(std::count(said.text.begin(), said.text.end(), '\n'), 1) << said.text;
        EXPECT_EQ(said.code, 2) << words;
    }
}

TEST(CaleProgram, HelpAndVersion) {
    const auto help = cale_says("--help");
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(cale_says("help").text, help.text);
    const auto nothing = cale_says("");
    EXPECT_EQ(nothing.text, help.text);
    EXPECT_EQ(nothing.code, 2);
    for (const std::string command :
         {"bench", "completion", "evaluate", "export", "games", "map", "play", "report", "sweep"}) {
        const auto text = cale_says("help " + command).text;
        EXPECT_EQ(text, cale_says(command + " --help").text);
        EXPECT_THAT(text, testing::AllOf(testing::HasSubstr("Examples:\n  "),
                                         testing::HasSubstr("cale " + command + " "),
                                         testing::HasSubstr("Exit codes: 0 ")));
    }
    EXPECT_THAT(cale_says("--version").text,
                testing::MatchesRegex("cale [0-9.]+ \\(LibTorch [0-9.]+.*, ALE [0-9.]+\\)\n"));
}

TEST(CaleProgram, FilesThatAreNoPolicyAreNotRead) {
    const TemporaryFolder folder;
    folder.write("text.txt", "A text, whose first letters would be a length of millions of gigabytes.");
    const auto text = cale_says("export text.txt -o out", folder.path());
    EXPECT_EQ(text.code, 1);
    EXPECT_THAT(text.text, testing::StartsWith("cale export: 'text.txt' is not a policy file: it does not"));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "out"));
    // /dev/zero would be read for ever.
    EXPECT_EQ(cale_says("evaluate /dev/null").text,
              "cale evaluate: '/dev/null' is not a policy file: it is no regular file\n");
}

TEST(CaleProgram, AReportIsCalledAfterItsFirstRuns) {
    const TemporaryFolder folder;
    folder.write("sweeps/encoders/a/episodes.csv",
                 "#{\"t_start\":0.0,\"env_id\":\"ALE/Pong-v5\",\"agent\":\"sac\",\"seed\":1}\n"
                 "r,l,t,global_step,frame,seed,env,truncated\n-20,100,1.5,100,400,1,0,0\n");
    folder.write("sweeps/encoders/a/config.yaml", "agent: {encoder: phi_sac}\n");
    for (const std::string runs : {"sweeps/encoders", "sweeps/encoders/", "sweeps/encoders/a/.."}) {
        const auto said = cale_says("report --resamples 10 " + runs, folder.path());
        EXPECT_EQ(said.code, 0) << said.text;
        EXPECT_THAT(said.text, testing::HasSubstr("reports/encoders/report.html"));
        EXPECT_GT(std::filesystem::remove_all(folder.path() / "reports/encoders"), 1u) << runs;
    }
    EXPECT_EQ(cale_says("report sweeps -o sweeps/encoders/a/config.yaml", folder.path()).text,
              "cale report: --output sweeps/encoders/a/config.yaml: this folder cannot be made: Not a "
              "directory; give another\n");
}

TEST(CaleProgram, AReportThatIsStrictFailsWhereARunIsMissing) {
    const TemporaryFolder folder;
    const auto add_run = [&](const std::string& game, int seed) {
        const auto run = fmt::format("runs/{}{}", game, seed);
        folder.write(run + "/episodes.csv",
                     fmt::format("#{{\"env_id\":\"ALE/{}-v5\",\"agent\":\"sac\",\"seed\":{}}}\n"
                                 "r,l,t,global_step,frame,seed,env,truncated\n1,100,1.5,100,400,1,0,0\n",
                                 game, seed));
        folder.write(run + "/config.yaml", "agent: {encoder: phi_sac}\n");
    };
    add_run("Pong", 1);
    add_run("Pong", 2);
    add_run("Boxing", 1);
    EXPECT_EQ(cale_says("report runs --resamples 10", folder.path()).code, 0);
    const auto incomplete = cale_says("report runs --resamples 10 --strict", folder.path());
    EXPECT_EQ(incomplete.code, 1);
    EXPECT_THAT(incomplete.text, testing::HasSubstr("1 run is missing:\n  sac on Boxing, seed 2\n"));
    EXPECT_THAT(incomplete.text,
                testing::HasSubstr("cale report: --strict: the grid of the runs is not complete"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "reports/runs/report.html"));
    add_run("Boxing", 2);
    EXPECT_EQ(cale_says("report runs --resamples 10 --strict", folder.path()).code, 0);
}

TEST(CaleEmulator, EvaluatesAndExportsARun) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path() / "run")).code, 0);
    EXPECT_EQ(cale_says("evaluate run --set agent.gamma=0.1", folder.path()).text,
              "cale evaluate: --set agent.gamma=0.1: nothing is trained here, so only settings env.* can be "
              "changed\n");
    folder.write("file", "");
    const auto no_folder = cale_says("evaluate run --out file", folder.path());
    EXPECT_EQ(no_folder.code, 2);
    EXPECT_THAT(no_folder.text, testing::StartsWith("cale evaluate: --out file: this folder cannot be made"));

    EXPECT_EQ(cale_says("export run -o run.onnx", folder.path()).code, 0);
    EXPECT_EQ(cale_says("export run -o run.safetensors", folder.path()).code, 0);
    EXPECT_EQ(cale_says("export run.safetensors -o again.onnx --format policy", folder.path()).code, 0);
    EXPECT_EQ(folder.read("again.onnx"), folder.read("run.safetensors"));
    EXPECT_THAT(cale_says("export run.onnx -o x", folder.path()).text,
                testing::HasSubstr("is not a policy file"));
}

TEST(CaleEmulator, AFoldersNameNeedNotBeUtf8) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "m\xfcller";
    ASSERT_EQ(train_sac(small(run)).code, 0);
    const auto resumed =
        train_sac({"--resume", "--run-dir", run.string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
    const auto evaluated =
        cale_says("evaluate m\xfcller --episodes 1 --set env.max_frames_per_episode=40", folder.path());
    EXPECT_EQ(evaluated.code, 0) << evaluated.text;
}

TEST(CaleEmulator, FilmsAPolicyWhereThereIsNoDisplay) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path() / "run")).code, 0);
    for (const auto* name : {"DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "SDL_VIDEODRIVER"})
        ::unsetenv(name);
    const auto film = cale_says("play --policy run --set env.max_frames_per_episode=40", folder.path());
    EXPECT_EQ(film.code, 0) << film.text;
    EXPECT_THAT(film.text, testing::HasSubstr("filming instead\n"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "play_pong.mp4")) << film.text;
    EXPECT_THAT(cale_says("play pong").text, testing::HasSubstr("give --policy FILE"));
}

TEST(ProgramSlow, EveryGameRunsUnderThe100kPreset) {
    for (const Game& game : games()) {
        const TemporaryFolder folder;
        const auto answer = train_sac(
            small(folder.path(), {"--config", CALE_SOURCE_DIR "/configs/sac/atari100k.yaml",
                                  "env.game=" + std::string(game.name), "train.save_replay=false"}));
        EXPECT_EQ(answer.code, 0) << game.name << ": " << answer.stderr_text;
    }
}

}  // namespace
}  // namespace cale
