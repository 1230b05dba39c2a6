// The training loop, with a small agent whose every call is known, and with SAC itself.
#include "train/time_report.h"
#include "train/training.h"
#include "train/training_world.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <numeric>
#include <random>
#include <set>
#include <sstream>
#include <tuple>

#include <fmt/format.h>
#include <torch/types.h>
#include <nlohmann/json.hpp>

#include "agents/sac.h"
#include "cale/random_play.h"
#include "report/learning_curve.h"
#include "storage/files.h"
#include "support/temporary_folder.h"
#include "support/terminal.h"
#include "train/checkpoint.h"
#include "train/log.h"
#include "train/safetensors.h"
#include "train/tensorboard.h"

namespace cale {
namespace {

using test::TemporaryFolder;
using testing::HasSubstr;
using testing::Not;

namespace fs = std::filesystem;

/// Moves at random and writes down what is asked of it.
class ScribeAgent : public Agent {
  public:
    explicit ScribeAgent(std::int64_t num_envs) : num_envs_(num_envs) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        if (mode == ActMode::evaluate) {
            ++evaluated;
            return torch::tensor({{1.0f, 0.0f, 1.0f}});
        }
        calls += 'a';
        first_frames_blank.push_back(observations.slice(1, 0, 3).sum().item<std::int64_t>() == 0);
        auto actions = torch::empty({3, num_envs_}).t();  // as a network's output may lie in memory
        std::uniform_real_distribution<float> unit(0, 1);
        for (std::int64_t i = 0; i < num_envs_; ++i) {
            actions[i][0] = unit(random_);
            actions[i][1] = 3.14f * (2 * unit(random_) - 1);
            actions[i][2] = unit(random_);
        }
        return actions;
    }
    void observe(const StepBatch& experiences) override {
        calls += 'o';
        steps += num_envs_;
        for (const auto& result : experiences.results) {
            rewards += result.reward;
            ++events[result.event];
        }
        if (steps == interrupt_at) raise(SIGINT);
    }
    bool update(const torch::Tensor&) override {
        calls += 'u';
        return false;
    }
    std::map<std::string, double> metrics() override { return {{"losses/qf_loss", 0.5}}; }
    TensorMap state() override { return {{"steps", torch::tensor(steps)}}; }
    void load_state(const TensorMap& state) override { steps = state.at("steps").item<std::int64_t>(); }

    std::int64_t steps = 0, evaluated = 0, interrupt_at = -1;
    double rewards = 0;
    EventCounts events{};
    std::string calls;
    std::vector<bool> first_frames_blank;

  private:
    std::int64_t num_envs_;
    std::mt19937 random_{1};
};

/// Is stopped in an evaluation, at this decision of all that it has played; -1: is not.
struct InterruptedInEvaluation : ScribeAgent {
    using ScribeAgent::ScribeAgent;
    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        if (mode == ActMode::evaluate && evaluated == cut_at) raise(SIGTERM);
        return ScribeAgent::act(observations, mode);
    }
    std::int64_t cut_at = 3;
};

std::int64_t occurrences(std::string_view text, std::string_view part) {
    std::int64_t count = 0;
    for (auto at = text.find(part); at != text.npos; at = text.find(part, at + 1)) ++count;
    return count;
}

class TrainingEmulator : public testing::Test {
  protected:
    TrainingEmulator() {
        env = protocol_atari100k("breakout");
        train_config.total_steps = 400;
        train_config.checkpoint_every = 150;
        eval.episodes = 1;
        env.max_frames_per_episode = 1200;
        log.every = 100;
        options.run_dir = folder.path();
        options.progress_bar = false;
        options.agent_name = "scribe";
    }

    Outcome train(Agent& agent) {
        return cale::train(agent, training_world(env, eval), {train_config, eval, log}, options);
    }
    /// Trains a scribe in a `Made`, which is made of `arguments`.
    template <class Made, class... Arguments>
    Outcome train_in(Arguments... arguments) {
        TrainingWorld world;
        world.id = world.name = "Made";
        world.num_envs = Made(arguments...).size();
        ScribeAgent agent(world.num_envs);
        world.make = [=](std::span<const std::uint32_t>) { return std::make_unique<Made>(arguments...); };
        return cale::train(agent, world, {train_config, eval, log}, options);
    }
    std::vector<std::string> lines(const std::string& name) const {
        std::istringstream text(read_file(folder.path() / name));
        std::vector<std::string> result;
        for (std::string line; std::getline(text, line);) result.push_back(line);
        return result;
    }

    std::vector<double> steps_in_table() const {
        return read_progress(folder.path() / "progress.csv").at("global_step");
    }

    TemporaryFolder folder;
    EnvConfig env;
    TrainConfig train_config;
    EvalConfig eval;
    LogConfig log;
    TrainOptions options;
};

TEST_F(TrainingEmulator, AsksUpdateActObserveInThatOrder) {
    ScribeAgent agent(1);
    eval.episodes = 0;
    train_config.total_steps = 3;
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_EQ(agent.calls, "uaouaouao");
    EXPECT_TRUE(agent.first_frames_blank.front());
    EXPECT_FALSE(agent.first_frames_blank.back() && agent.first_frames_blank[1]);
}

TEST_F(TrainingEmulator, OverlapDecidesBeforeItLearns) {
    ScribeAgent agent(1);
    eval.episodes = 0;
    train_config.total_steps = 3;
    train_config.overlap = true;
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_EQ(agent.calls, "auoauoauo");
}

TEST_F(TrainingEmulator, OverlapPlaysTheSameGamesWhereNothingIsLearnt) {
    eval.episodes = 0;
    env.num_envs = 2;
    std::vector<std::string> episodes;
    for (const bool overlap : {false, true}) {
        const TemporaryFolder place;
        options.run_dir = place.path();
        train_config.overlap = overlap;
        ScribeAgent agent(2);
        train(agent);
        episodes.push_back(read_file(place.path() / "episodes.csv"));
    }
    EXPECT_EQ(episodes[0], episodes[1]);
    EXPECT_GT(episodes[0].size(), 100u);
}

TEST_F(TrainingEmulator, OverlapReportsWhatFailedInAnEnvironment) {
    struct OutOfBounds : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            return ScribeAgent::act(observations, mode) + 2;
        }
    } agent(1);
    train_config.overlap = true;
    EXPECT_THROW(train(agent), std::exception);
}

TEST_F(TrainingEmulator, TheTimeOfARunIsSplitWithoutRemainder) {
    ScribeAgent agent(1);
    eval.episodes = 0;
    train(agent);
    const auto columns = read_progress(folder.path() / "progress.csv");
    for (std::size_t row = 0; row < columns.at("seconds").size(); ++row) {
        double sum = 0;
        for (const auto& [name, part] : kTimeParts) {
            EXPECT_GE(columns.at("time/" + std::string(name))[row], 0) << name;
            sum += columns.at("time/" + std::string(name))[row];
        }
        EXPECT_NEAR(sum, 1, 1e-9);
        EXPECT_GT(columns.at("time/environment")[row], 0);
    }
}

TEST_F(TrainingEmulator, TensorBoardShowsWhatTheTableHas) {
    eval.every = 200;
    ScribeAgent agent(1);
    EXPECT_EQ(train(agent), Outcome::finished);
    const auto shown = test::read_by_tensorboard(folder.path()).at("scalars");
    const auto table = read_progress(folder.path() / "progress.csv");
    const auto& steps = table.at("global_step");
    ASSERT_EQ(steps.size(), 4u);
    int tags = 0;
    for (const auto& [name, values] : table) {
        const bool has_tag = name.find('/') != name.npos;
        if (!has_tag && name != "steps_per_second") continue;
        const auto& curve = shown.at(has_tag ? name : "charts/SPS");
        std::size_t point = 0;
        for (std::size_t row = 0; row < steps.size(); ++row) {
            if (std::isnan(values[row])) continue;  // no game had ended
            ASSERT_LT(point, curve.size()) << name;
            EXPECT_EQ(curve[point][0], steps[row]) << name;
            const double rounding = has_tag ? 1e-6 * std::abs(values[row]) : 0.01;
            EXPECT_NEAR(curve[point][1].get<double>(), values[row], rounding) << name;
            ++point;
        }
        EXPECT_EQ(curve.size(), point) << name;
        ++tags;
    }
    EXPECT_GE(tags, 12) << "shares of time and zones, dormant units, returns and speed";
    const auto returns_at = [this](const std::string& step) {
        return read_progress(folder.path() / "eval" / ("step_" + step + ".csv")).at("return").front();
    };
    const auto& evaluations = shown.at("eval/episodic_return");
    ASSERT_EQ(evaluations.size(), 2u);
    EXPECT_EQ(evaluations[0], (nlohmann::json{200, returns_at("000000200")}));
    EXPECT_EQ(evaluations[1], (nlohmann::json{400, returns_at("000000400")}));
    EXPECT_EQ(shown.at("charts/episodic_return").size(), lines("episodes.csv").size() - 2);
}

TEST_F(TrainingEmulator, TheLastRowHoldsWhatIsLeftAtTheEnd) {
    eval.episodes = 0;
    train_config.total_steps = 170;
    ScribeAgent agent(1);
    testing::internal::CaptureStderr();
    EXPECT_EQ(train(agent), Outcome::finished);
    const auto said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 170));
    EXPECT_THAT(
        said,
        testing::ContainsRegex(
            "\nstep 170/170  frames [0-9]+  [1-9][0-9.]* steps/s  ETA 0:00  episodes [^\n]*\nResults: "));
    EXPECT_EQ(said.find("step 170/170"), said.rfind("step 170/170")) << said;
    std::string events;
    for (const auto& file : fs::directory_iterator(folder.path()))
        if (file.path().filename().string().starts_with("events.out")) events = read_file(file.path());
    EXPECT_EQ(occurrences(events, "charts/SPS"), 2);

    // Longer, it is the run that was that long from the beginning.
    options.resume = true;
    train_config.total_steps = 250;
    ScribeAgent longer(1);
    train(longer);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 200, 250));
}

TEST_F(TrainingEmulator, ALongerRunHasNoRowOfItsOldEndWhereThatWasEvaluated) {
    eval.every = 85;
    train_config.total_steps = 170;
    ScribeAgent agent(1);
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 170));
    options.resume = true;
    train_config.total_steps = 250;
    ScribeAgent longer(1);
    EXPECT_EQ(train(longer), Outcome::finished);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 200, 250));
    const auto left = read_progress(folder.path() / "progress.csv").at("zones/left")[1];
    EXPECT_NEAR(100 * left, std::round(100 * left), 1e-9) << "a share of 100 steps, not of the last 30";
}

TEST_F(TrainingEmulator, AnInterruptedRunsLastRowIsGoneOnceItIsResumed) {
    eval.episodes = 0;
    ScribeAgent agent(1);
    agent.interrupt_at = 142;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 142));
    options.resume = true;
    ScribeAgent second(1);
    EXPECT_EQ(train(second), Outcome::finished);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 200, 300, 400));
}

TEST_F(TrainingEmulator, ARunThatIsResumedAtItsEndHasItsLastRow) {
    InterruptedInEvaluation agent(1);
    eval.video = false;
    train_config.total_steps = 170;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    options.resume = true;
    ScribeAgent second(1);
    EXPECT_EQ(train(second), Outcome::finished);
    EXPECT_THAT(steps_in_table(), testing::ElementsAre(100, 170));
    EXPECT_EQ(read_progress(folder.path() / "progress.csv").at("losses/qf_loss").back(), 0.5);
    const auto table = folder.read("progress.csv");
    ScribeAgent third(1);
    EXPECT_EQ(train(third), Outcome::finished);
    EXPECT_EQ(folder.read("progress.csv"), table) << "where no step follows the last row stays";
}

TEST_F(TrainingEmulator, ARunThatIsResumedBehindItsLastEvaluationHasTheMetricsOfItsLastUpdate) {
    /// Has no metrics until its next update, as agents that learn.
    struct Forgetful : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        void load_state(const TensorMap& state) override {
            ScribeAgent::load_state(state);
            loaded = true;
        }
        std::map<std::string, double> metrics() override {
            return loaded ? std::map<std::string, double>{} : ScribeAgent::metrics();
        }
        bool loaded = false;
    };
    eval.every = 100;
    eval.video = false;
    train_config.total_steps = 170;
    train_config.keep_best = true;
    Forgetful agent(1);
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_TRUE(agent.loaded) << "a longer run has no evaluation at step 170";
    options.resume = true;
    Forgetful again(1);
    EXPECT_EQ(train(again), Outcome::finished);
    EXPECT_THAT(read_progress(folder.path() / "progress.csv").at("losses/qf_loss"),
                testing::ElementsAre(0.5, 0.5));
}

TEST_F(TrainingEmulator, LeavesTheFilesOfARun) {
    ScribeAgent agent(1);
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_EQ(agent.steps, 400);
    EXPECT_GT(agent.evaluated, 0);
    EXPECT_EQ(lines("progress.csv").size(), 5u) << "a header and a row every 100 steps";
    EXPECT_GE(lines("episodes.csv").size(), 3u) << "two comment lines and at least one game of breakout";
    for (const auto* name : {"learning_curve.svg", "videos/step_000000400.mp4", "eval/step_000000400.csv",
                             "checkpoints/step_000000400/state.json"}) {
        EXPECT_TRUE(fs::exists(folder.path() / name)) << name;
    }
    EXPECT_EQ(list_checkpoints(folder.path()).size(), 2u) << "of three, keep_checkpoints stay";
}

TEST_F(TrainingEmulator, TheCurveAndTheClosingLineShowRandomPlayWithTheRunsActions) {
    struct DiscreteAgent : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        torch::Tensor act(const torch::Tensor&, ActMode) override {
            return torch::full({1}, steps % 4, torch::kInt64);
        }
    } discrete(1);
    eval.episodes = 0;
    env.max_frames_per_episode = 108'000;
    env.action_space = ActionSet::minimal;
    testing::internal::CaptureStderr();
    train(discrete);
    EXPECT_THAT(testing::internal::GetCapturedStderr(),
                testing::ContainsRegex("Mean return of the last [0-9]+ games? in training: [0-9.]+, [0-9.]+ "
                                       "(less|more) than random play \\(1\\.7\\)\nResults: "));
    EXPECT_THAT(read_file(folder.path() / "learning_curve.svg"), HasSubstr(">random 1.7<"));

    const TemporaryFolder place;
    options.run_dir = place.path();
    env.action_space = ActionSet::continuous;
    ScribeAgent joystick(1);
    train(joystick);
    const auto curve = read_file(place.path() / "learning_curve.svg");
    EXPECT_THAT(curve, HasSubstr(fmt::format(">random {:.1f}<", random_floor(env).value())));
    EXPECT_THAT(curve, Not(HasSubstr(">random 1.7<")));
}

std::vector<std::string> checkpoints_in(const fs::path& run) {
    std::vector<std::string> names;
    for (const auto& folder : list_checkpoints(run)) names.push_back(folder.filename());
    return names;
}
nlohmann::json score_in(const fs::path& checkpoint) {
    return nlohmann::json::parse(read_file(checkpoint / "state.json")).at("score");
}

TEST_F(TrainingEmulator, KeepsTheBestOfTrainingAndThoseAtMultiples) {
    eval.episodes = 0;
    train_config.total_steps = 1500;
    train_config.checkpoint_every = 250;
    train_config.keep_every = 400;
    train_config.keep_best = true;
    train_config.keep_checkpoints = 100;
    ScribeAgent all(1);
    train(all);
    EXPECT_EQ(list_checkpoints(folder.path()).size(), 10u) << "7 of every 250 from 0, 3 of every 400";
    std::string best;
    double largest = -1;
    for (const auto& checkpoint : list_checkpoints(folder.path())) {
        const auto score = score_in(checkpoint);
        if (score.is_null()) continue;
        EXPECT_EQ(score["of"], "training");
        if (score["mean_return"] <= largest) continue;
        largest = score["mean_return"];
        best = checkpoint.filename();
    }
    ASSERT_GT(largest, 0);
    EXPECT_EQ(fs::read_symlink(folder.path() / "checkpoints" / "best"), best);

    const TemporaryFolder place;
    options.run_dir = place.path();
    train_config.keep_checkpoints = 1;
    ScribeAgent few(1);
    train(few);
    std::set<std::string> expected{"step_000000400", "step_000000800", "step_000001200", "step_000001500",
                                   best};
    EXPECT_THAT(checkpoints_in(place.path()), testing::ElementsAreArray(expected));
    EXPECT_EQ(fs::read_symlink(place.path() / "checkpoints" / "best"), best);
}

TEST_F(TrainingEmulator, KeepsTheBestOfEvaluationsAlsoWhereOneWasCutOff) {
    eval.every = 200;
    eval.video = false;
    train_config.total_steps = 500;
    train_config.checkpoint_every = 300;
    train_config.keep_checkpoints = 1;
    train_config.keep_best = true;
    for (const int cut_at : {-1, 3}) {
        const TemporaryFolder place;
        options.run_dir = place.path();
        options.resume = false;
        InterruptedInEvaluation agent(1);
        agent.cut_at = cut_at;
        if (cut_at >= 0) {
            EXPECT_EQ(train(agent), Outcome::interrupted);
            EXPECT_TRUE(score_in(place.path() / "checkpoints" / "step_000000200").is_null());
            options.resume = true;
            agent.cut_at = -1;
        }
        EXPECT_EQ(train(agent), Outcome::finished);
        // Its evaluations all come to the same return: of equal ones the first stays.
        EXPECT_THAT(checkpoints_in(place.path()), testing::ElementsAre("step_000000200", "step_000000500"))
            << cut_at;
        const auto best = score_in(place.path() / "checkpoints" / "best");
        EXPECT_EQ(best["of"], "evaluation");
        EXPECT_EQ(score_in(place.path() / "checkpoints" / "step_000000500")["of"], "evaluation");

        options.resume = true;
        ScribeAgent again(1);
        EXPECT_EQ(train(again), Outcome::finished);
        EXPECT_EQ(again.evaluated, 0) << "no evaluation is played twice";
    }
}

TEST_F(TrainingEmulator, KeepsTheCheckpointOfTheLargestEvaluation) {
    /// Serves no ball, and scores nothing, but in its second evaluation.
    struct OnceGood : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            if (mode != ActMode::evaluate) return ScribeAgent::act(observations, mode);
            if (steps != 400) return torch::zeros({1, 3});
            return torch::tensor({{1.0f, ++decisions % 7 < 4 ? 0.0f : 3.0f, 1.0f}});
        }
        int decisions = 0;
    } agent(1);
    eval.every = 200;
    eval.episodes = 2;
    eval.video = false;
    train_config.total_steps = 600;
    train_config.checkpoint_every = 200;
    train_config.keep_checkpoints = 3;
    train_config.keep_best = true;
    EXPECT_EQ(train(agent), Outcome::finished);
    const auto checkpoints = folder.path() / "checkpoints";
    for (const std::string step : {"step_000000200", "step_000000400", "step_000000600"}) {
        const auto returns = read_progress(folder.path() / "eval" / (step + ".csv")).at("return");
        ASSERT_EQ(returns.size(), 2u);
        const double sum = returns[0] + returns[1];
        EXPECT_EQ(score_in(checkpoints / step).at("mean_return"), sum / 2) << step;
        EXPECT_EQ(sum > 0, step == "step_000000400") << step;
    }
    EXPECT_EQ(fs::read_symlink(checkpoints / "best"), "step_000000400");
}

TEST_F(TrainingEmulator, ShowsHowFarAnEvaluationIs) {
    test::Terminal terminal(100);
    const int standard_error = ::dup(STDERR_FILENO);
    ::dup2(::fileno(terminal.file()), STDERR_FILENO);
    options.progress_bar = true;
    eval.episodes = 2;
    eval.video = false;
    train_config.total_steps = 10;
    ScribeAgent agent(1);
    const auto outcome = train(agent);
    ::dup2(standard_error, STDERR_FILENO);
    ::close(standard_error);
    EXPECT_EQ(outcome, Outcome::finished);
    const auto shown = terminal.shown();
    EXPECT_THAT(shown, HasSubstr("]  evaluation  1/2 games  mean return "));
    EXPECT_THAT(shown, HasSubstr("]  evaluation  2/2 games  mean return "));
    EXPECT_LT(shown.find("evaluation  2/2"), shown.find("Evaluation at agent step 10: mean return "));
}

TEST_F(TrainingEmulator, AnEndThatCannotBeStoredIsAnError) {
    /// Replaces the folder of its checkpoints by a file, at the end.
    struct Saboteur : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        void observe(const StepBatch& experiences) override {
            ScribeAgent::observe(experiences);
            if (steps != last) return;
            fs::remove_all(checkpoints);
            write_file_atomically(checkpoints, "a file");
        }
        fs::path checkpoints;
        std::int64_t last = 400;
    };
    eval.episodes = 0;
    for (const bool interrupted : {false, true}) {
        const TemporaryFolder place;
        options.run_dir = place.path();
        Saboteur agent(1);
        agent.checkpoints = place.path() / "checkpoints";
        if (interrupted) agent.last = agent.interrupt_at = 142;
        EXPECT_THROW(train(agent), std::exception) << interrupted;
    }
}

TEST_F(TrainingEmulator, TheClockOfAResumedRunGoesOn) {
    eval.episodes = 0;
    ScribeAgent agent(1);
    agent.interrupt_at = 342;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    options.resume = true;
    ScribeAgent second(1);
    EXPECT_EQ(train(second), Outcome::finished);
    const auto seconds = read_progress(folder.path() / "progress.csv").at("seconds");
    ASSERT_EQ(seconds.size(), 4u);
    EXPECT_TRUE(std::ranges::is_sorted(seconds)) << testing::PrintToString(seconds);
}

TEST_F(TrainingEmulator, AnEvaluationHasATimeOfItsOwn) {
    ScribeAgent agent(1);
    eval.every = 85;
    eval.video = false;
    train(agent);
    const auto columns = read_progress(folder.path() / "progress.csv");
    EXPECT_THAT(columns.at("time/evaluation"), testing::Contains(testing::Gt(0)));
    EXPECT_THAT(columns.at("time/log"), testing::Each(testing::Ge(0)));
}

/// A world in which nothing is seen.
class BlankWorld : public World {
  public:
    std::int64_t size() const override { return 1; }
    ActionSpace action_space() const override { return joystick_space(); }
    ObservationSpace observation_space() const override { return {.stack = 4, .shape = {2, 2}}; }
    void reset(std::span<std::uint8_t> frames) override { std::ranges::fill(frames, 0); }
    std::vector<EpisodeRecord> record() const override { return {{}}; }
    void resume(std::span<const EpisodeRecord>) override {}
};

/// Whose episodes have one step, and a return that is their number, times `unit`.
class NumberedEpisodes final : public BlankWorld {
  public:
    explicit NumberedEpisodes(float unit = 1) : unit_(unit) {}
    void step(const Actions&, std::span<std::uint8_t> frames, std::span<std::uint8_t>,
              std::span<StepResult> results) override {
        std::ranges::fill(frames, 0);
        results[0] = {
            .reward = unit_ * static_cast<float>(++episodes_), .terminal = true, .episode_over = true};
    }

  private:
    float unit_;
    int episodes_ = 0;
};

TEST_F(TrainingEmulator, TheMeanReturnIsThatOfTheNewestHundredEpisodes) {
    eval.episodes = 0;
    train_config.total_steps = 150;
    log.every = 50;
    EXPECT_EQ(train_in<NumberedEpisodes>(), Outcome::finished);
    EXPECT_THAT(read_progress(folder.path() / "progress.csv").at("charts/avg_episodic_return"),
                testing::ElementsAre(25.5, 50.5, 100.5));
}

TEST(EvaluationInAWorld, RefusesARewardThatIsNoNumber) {
    const auto decide = [](const torch::Tensor&, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::zeros({1, 3})};
    };
    const auto make = [](auto) {
        return std::make_unique<NumberedEpisodes>(std::numeric_limits<float>::quiet_NaN());
    };
    EXPECT_THAT([&] { evaluate(decide, make, {.games = 1}); },
                testing::ThrowsMessage<std::invalid_argument>("the reward of an evaluation's game is nan"));
}

TEST(EvaluationInAWorld, EndsWhereItIsToldTo) {
    EvaluationPlan plan{.games = 5};
    int asked = 0;
    plan.stop = [&] { return ++asked > 3; };
    const auto decide = [](const torch::Tensor&, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::zeros({1, 3})};
    };
    const auto some = evaluate(
        decide, [](auto) { return std::make_unique<NumberedEpisodes>(); }, plan);
    EXPECT_TRUE(some.interrupted);
    ASSERT_EQ(some.games.size(), 3U);
    EXPECT_EQ(some.mean_return, 1);
}

/// Who says that a game is over, and not why.
class UnexplainedEnds final : public BlankWorld {
  public:
    void step(const Actions&, std::span<std::uint8_t> frames, std::span<std::uint8_t>,
              std::span<StepResult> results) override {
        std::ranges::fill(frames, 0);
        results[0] = {.episode_over = true};
    }
};

TEST_F(TrainingEmulator, AWorldWhoseEndsContradictEachOtherIsNamed) {
    eval.episodes = 0;
    train_config.total_steps = 10;
    EXPECT_THAT([&] { train_in<UnexplainedEnds>(); },
                testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr(
                    "a step of environment 0 has episode_over, but neither terminal nor truncated")));
}

/// Whose steps last 1, 4 and 2 frames in turn, and whose games take three steps, every other one cut off.
class UnevenSteps final : public BlankWorld {
  public:
    void step(const Actions&, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) override {
        std::ranges::fill(frames, 0);
        std::ranges::fill(final_frames, 0);
        const bool over = ++steps_ % 3 == 0, cut_off = over && steps_ % 2 == 0;
        results[0] = {.reward = 1,
                      .terminal = over && !cut_off,
                      .truncated = cut_off,
                      .episode_over = over,
                      .frames = std::array{2, 1, 4}[static_cast<std::size_t>(steps_ % 3)]};
    }

  private:
    int steps_ = 0;
};

TEST_F(TrainingEmulator, TablesHaveTheStepsAndTheFramesThatWerePlayed) {
    eval.episodes = 0;
    train_config.total_steps = 10;
    log.every = 5;
    EXPECT_EQ(train_in<UnevenSteps>(), Outcome::finished);
    const auto rows = lines("episodes.csv");
    ASSERT_EQ(rows.size(), 5U);
    EXPECT_EQ(rows[2], "3,3,0.116667,3,7,1,0,0");
    EXPECT_EQ(rows[3], "3,3,0.233333,6,14,1,0,1");
    EXPECT_EQ(rows[4], "3,3,0.350000,9,21,1,0,0");
    const auto progress = read_progress(folder.path() / "progress.csv");
    EXPECT_THAT(progress.at("global_step"), testing::ElementsAre(5, 10));
    EXPECT_THAT(progress.at("frame"), testing::ElementsAre(12, 22));
}

TEST_F(TrainingEmulator, StepsPerSecondAreThoseSinceTheRowBefore) {
    eval.episodes = 0;
    ScribeAgent agent(1);
    train(agent);
    const auto table = read_progress(folder.path() / "progress.csv");
    const auto &steps = table.at("global_step"), &seconds = table.at("seconds"),
               &speeds = table.at("steps_per_second");
    ASSERT_EQ(steps.size(), 4U);
    for (std::size_t i = 1; i < steps.size(); ++i) {
        const double time = seconds[i] - seconds[i - 1];  // to a thousandth
        EXPECT_GE(speeds[i] * (time + 0.0011), steps[i] - steps[i - 1]);
        EXPECT_LE(speeds[i] * std::max(0.0, time - 0.0011), (steps[i] - steps[i - 1]) * 1.01);
    }
}

TEST_F(TrainingEmulator, TheClosingLineHasTheMeanOfTheNewestTenGames) {
    eval.episodes = 0;
    train_config.total_steps = 150;
    testing::internal::CaptureStderr();
    train_in<NumberedEpisodes>();
    EXPECT_THAT(testing::internal::GetCapturedStderr(),
                HasSubstr("Mean return of the last 10 games in training: 145.5"));
}

TEST_F(TrainingEmulator, EnvironmentsHaveSeedsOfTheirOwnThatFollowFromTheRuns) {
    const auto seeds_of = [&](std::int64_t seed) {
        const TemporaryFolder place;
        options.run_dir = place.path();
        train_config.seed = seed;
        train_config.total_steps = 4;
        eval.episodes = 0;
        env.num_envs = 4;
        std::vector<std::uint32_t> seen;
        auto world = training_world(env, eval);
        world.make = [&, make = world.make](std::span<const std::uint32_t> seeds) {
            seen.assign(seeds.begin(), seeds.end());
            return make(seeds);
        };
        ScribeAgent agent(4);
        cale::train(agent, world, {train_config, eval, log}, options);
        return seen;
    };
    const auto first = seeds_of(1), again = seeds_of(1), second = seeds_of(2);
    EXPECT_EQ(first, again);
    std::set<std::uint32_t> all(first.begin(), first.end());
    all.insert(second.begin(), second.end());
    EXPECT_EQ(all.size(), 8U);
}

TEST_F(TrainingEmulator, EvaluationsHaveNoOpsOfTheirOwn) {
    env.game = "ms_pacman";  // in which something moves from the first frame on
    const auto frames_at_the_start = [&](std::int64_t training_noops, std::int64_t evaluation_noops) {
        env.noop_max = training_noops;
        eval.noop_max = evaluation_noops;
        std::set<std::string> starts;
        EvaluationPlan plan{.games = 6, .seed = 1};
        std::int64_t game = -1;
        training_world(env, eval).evaluate(
            [&](const torch::Tensor& observations, std::span<const std::int64_t> numbers) {
                if (std::exchange(game, numbers.front()) != numbers.front()) {
                    const auto newest = observations[0][3].contiguous();
                    starts.emplace(reinterpret_cast<const char*>(newest.const_data_ptr()), newest.nbytes());
                }
                return Chosen{.actions = torch::tensor({{1.0f, 0.0f, 0.0f}})};
            },
            plan);
        return starts.size();
    };
    EXPECT_EQ(frames_at_the_start(29, 0), 1U);
    EXPECT_GT(frames_at_the_start(0, 29), 1U);
}

TEST_F(TrainingEmulator, StopsAtAReturnThatNoReaderOfItsFilesWouldTake) {
    eval.episodes = 0;
    EXPECT_THAT(
        [&] { train_in<NumberedEpisodes>(4e11F); },
        testing::ThrowsMessage<std::runtime_error>(testing::StartsWith("a game ended with a return of ")));
    EXPECT_EQ(read_episodes(folder.path() / "episodes.csv").returns.size(), 2U) << "which can be read";
}

TEST_F(TrainingEmulator, AFinishedRunMadeLongerPlaysItsEvaluationsAsOneThatWasNot) {
    /// Its evaluations differ by how many decisions it made in those before.
    struct Drawing : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            auto actions = ScribeAgent::act(observations, mode);
            if (mode != ActMode::evaluate) return actions;
            const bool right = ++drawn % 7 < 4;
            return torch::tensor({{1.0f, right ? 0.0f : 3.0f, 1.0f}});
        }
        TensorMap state() override {
            return {{"steps", torch::tensor(steps)}, {"drawn", torch::tensor(drawn)}};
        }
        void load_state(const TensorMap& state) override {
            ScribeAgent::load_state(state);
            drawn = state.at("drawn").item<std::int64_t>();
        }
        std::int64_t drawn = 0;
    };
    eval.every = 100;
    eval.video = false;
    for (const bool keep_best : {false, true}) {
        train_config.keep_best = keep_best;
        std::vector<std::string> evaluations;
        for (const std::vector<std::int64_t>& lengths :
             std::vector<std::vector<std::int64_t>>{{300}, {200, 300}, {250, 300}}) {
            const TemporaryFolder place;
            options.run_dir = place.path();
            options.resume = false;
            for (const auto length : lengths) {
                train_config.total_steps = length;
                Drawing agent(1);
                EXPECT_EQ(train(agent), Outcome::finished);
                options.resume = true;
            }
            evaluations.push_back(read_file(place.path() / "eval" / "step_000000300_events.csv"));
        }
        EXPECT_EQ(evaluations[1], evaluations[0]) << "at 200 an evaluation was due";
        EXPECT_EQ(evaluations[2], evaluations[0]) << "at 250 there was one because the run ended";
    }
}

TEST_F(TrainingEmulator, CanGoOnFromTheFirstStep) {
    struct Killed {};
    struct KilledAgent : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        std::filesystem::path run;
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            EXPECT_THAT(list_checkpoints(run), testing::SizeIs(1)) << "before the first step";
            if (steps == 3) throw Killed();
            return ScribeAgent::act(observations, mode);
        }
    } killed(1);
    killed.run = folder.path();
    EXPECT_THROW(train(killed), Killed);
    ASSERT_EQ(list_checkpoints(folder.path()).size(), 1u);
    options.resume = true;
    ScribeAgent resumed(1);
    EXPECT_EQ(train(resumed), Outcome::finished);
    const auto episodes = read_file(folder.path() / "episodes.csv");

    const TemporaryFolder place;
    options.run_dir = place.path();
    options.resume = false;
    ScribeAgent undisturbed(1);
    EXPECT_EQ(train(undisturbed), Outcome::finished);
    EXPECT_EQ(read_file(place.path() / "episodes.csv"), episodes);
}

TEST_F(TrainingEmulator, CountsWhatIsAskedOfTheJoystick) {
    env.num_envs = 2;
    ScribeAgent agent(2);
    EXPECT_EQ(train(agent), Outcome::finished);
    EXPECT_EQ(std::accumulate(agent.events.begin(), agent.events.end(), std::int64_t{0}), 400)
        << "no evaluation among them";
    EXPECT_EQ(read_file(folder.path() / "joystick_events.csv"), event_table(agent.events));
    EXPECT_LE(std::ranges::count(agent.events, 0), 4) << "nearly all of the 18 come up";
}

/// Two environments, with episodes of two steps and rewards of 1, and of three steps and rewards of 10.
class TwoLengths final : public BlankWorld {
  public:
    std::int64_t size() const override { return 2; }
    std::vector<EpisodeRecord> record() const override { return {{}, {}}; }
    void step(const Actions&, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) override {
        std::ranges::fill(frames, 0);
        std::ranges::fill(final_frames, 0);
        ++steps_;
        for (const int env : {0, 1}) {
            const bool over = steps_ % (env + 2) == 0;
            results[static_cast<std::size_t>(env)] = {
                .reward = env == 0 ? 1.0f : 10.0f, .terminal = over, .episode_over = over};
        }
    }

  private:
    int steps_ = 0;
};

TEST_F(TrainingEmulator, CountsTheReturnsOfEveryEnvironment) {
    eval.episodes = 0;
    train_config.total_steps = 12;
    EXPECT_EQ(train_in<TwoLengths>(), Outcome::finished);
    std::multiset<std::tuple<double, int, int>> episodes;  // return, length, environment
    for (const auto& row : lines("episodes.csv")) {
        double episode_return = 0, seconds = 0;
        int length = 0, step = 0, frame = 0, seed = 0, number = 0;
        if (std::sscanf(row.c_str(), "%lf,%d,%lf,%d,%d,%d,%d", &episode_return, &length, &seconds, &step,
                        &frame, &seed, &number) == 7)
            episodes.emplace(episode_return, length, number);
    }
    EXPECT_THAT(episodes, testing::ElementsAre(std::tuple(2, 2, 0), std::tuple(2, 2, 0), std::tuple(2, 2, 0),
                                               std::tuple(30, 3, 1), std::tuple(30, 3, 1)));
}

TEST_F(TrainingEmulator, ResumesWhereTheCheckpointStood) {
    eval.episodes = 0;
    ScribeAgent first(1);
    train(first);
    const auto episodes_before = lines("episodes.csv");
    // Rows from after the checkpoint, as a killed run leaves them, must go.
    std::ofstream(folder.path() / "episodes.csv", std::ios::app) << "9,9,9,9,9,9,9,0\n";

    options.resume = true;
    train_config.total_steps = 700;
    ScribeAgent second(1);
    EXPECT_EQ(train(second), Outcome::finished);
    EXPECT_EQ(second.steps, 700);
    const auto episodes = lines("episodes.csv");
    ASSERT_GE(episodes.size(), episodes_before.size());
    for (std::size_t i = 0; i < episodes_before.size(); ++i) EXPECT_EQ(episodes[i], episodes_before[i]);
    for (const auto& line : episodes) EXPECT_EQ(line.find("9,9,9"), std::string::npos);
    EXPECT_EQ(lines("progress.csv").size(), 8u);
}

TEST_F(TrainingEmulator, AnInterruptLeavesACheckpoint) {
    ScribeAgent agent(1);
    agent.interrupt_at = 42;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    ASSERT_EQ(list_checkpoints(folder.path()).size(), 2u);
    EXPECT_EQ(list_checkpoints(folder.path()).back().filename(), "step_000000042");
    EXPECT_EQ(agent.evaluated, 0);
}

TEST_F(TrainingEmulator, AnInterruptedEvaluationIsPlayedWhenTheRunGoesOn) {
    InterruptedInEvaluation agent(1);
    eval.every = 50;
    eval.video = false;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    EXPECT_EQ(agent.evaluated, 4) << "at once";
    EXPECT_EQ(agent.steps, 50);
    EXPECT_EQ(list_checkpoints(folder.path()).back().filename(), "step_000000050");
    EXPECT_FALSE(fs::exists(folder.path() / "eval" / "step_000000050.csv"));

    options.resume = true;
    ScribeAgent second(1);
    EXPECT_EQ(train(second), Outcome::finished);
    for (const auto* csv : {"step_000000050.csv", "step_000000100.csv", "step_000000400.csv"})
        EXPECT_TRUE(fs::exists(folder.path() / "eval" / csv)) << csv;
}

TEST_F(TrainingEmulator, AnInterruptedEvaluationIsPlayedAlsoWhereItWasAskedForAnew) {
    InterruptedInEvaluation second(1);
    train_config.total_steps = 100;
    eval.every = 50;
    eval.video = false;
    ScribeAgent agent(1);
    EXPECT_EQ(train(agent), Outcome::finished);
    const auto table = folder.path() / "eval" / "step_000000100.csv";
    const auto lines = [&] { return occurrences(read_file(table), "\n"); };
    const auto of_one_game = lines();

    options.resume = options.finished = options.evaluates_otherwise = true;
    eval.episodes = 2;
    EXPECT_EQ(train(second), Outcome::interrupted);
    EXPECT_EQ(lines(), of_one_game);
    options.finished = options.evaluates_otherwise = false;  // as its metadata and its checkpoint have it now
    ScribeAgent third(1);
    EXPECT_EQ(train(third), Outcome::finished);
    EXPECT_EQ(lines(), of_one_game + 1);
}

// With a checkpoint on the last step and without.
class InterruptedEndEmulator : public TrainingEmulator, public testing::WithParamInterface<std::int64_t> {};
INSTANTIATE_TEST_SUITE_P(CheckpointEvery, InterruptedEndEmulator, testing::Values(150, 100));

TEST_P(InterruptedEndEmulator, TheLastEvaluationIsPlayedByALongerRun) {
    struct InterruptedInLastEvaluation : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            if (mode == ActMode::evaluate && steps == 100) raise(SIGTERM);
            return ScribeAgent::act(observations, mode);
        }
    } agent(1);
    train_config.total_steps = 100;
    train_config.checkpoint_every = GetParam();
    eval.every = 50;
    eval.video = false;
    EXPECT_EQ(train(agent), Outcome::interrupted);
    const auto last = folder.path() / "eval" / "step_000000100.csv";
    EXPECT_FALSE(fs::exists(last));

    options.resume = true;
    train_config.total_steps = 120;
    ScribeAgent longer(1);
    EXPECT_EQ(train(longer), Outcome::finished);
    EXPECT_TRUE(fs::exists(last));
    EXPECT_TRUE(fs::exists(folder.path() / "eval" / "step_000000120.csv"));
}

TEST_F(TrainingEmulator, ANumberThatIsNotFiniteStopsTheRun) {
    struct Diverging : ScribeAgent {
        using ScribeAgent::ScribeAgent;
        std::map<std::string, double> metrics() override {
            return {{"losses/qf_loss", steps < 50 ? 0.5 : std::numeric_limits<double>::quiet_NaN()}};
        }
    } agent(1);
    try {
        train(agent);
        FAIL() << "it went on";
    } catch (const std::runtime_error& error) {
        EXPECT_THAT(error.what(), testing::HasSubstr("losses/qf_loss became nan by agent step 100"));
    }
}

TEST_F(TrainingEmulator, ADamagedCheckpointIsNamedAndTheOneBeforeTaken) {
    eval.episodes = 0;
    ScribeAgent first(1);
    train(first);
    const auto episodes = read_file(folder.path() / "episodes.csv");
    const auto newest = list_checkpoints(folder.path()).back();
    fs::resize_file(newest / "agent.safetensors.zst", 20);
    options.resume = true;
    ScribeAgent second(1);
    testing::internal::CaptureStderr();
    EXPECT_EQ(train(second), Outcome::finished);
    const auto said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(said, testing::HasSubstr("The checkpoint " + newest.string() + " cannot be read"));
    EXPECT_THAT(said, testing::HasSubstr("it is kept as checkpoints/step_*.damaged"));
    EXPECT_THAT(said, testing::HasSubstr("Resumed at agent step 300"));
    EXPECT_EQ(second.steps, 400);

    for (const auto& checkpoint : list_checkpoints(folder.path()))
        fs::resize_file(checkpoint / "games.safetensors", 20);
    try {
        train(second);
        FAIL() << "it was accepted";
    } catch (const ResumeError& error) {
        EXPECT_THAT(error.what(), testing::HasSubstr("no checkpoint of " + folder.path().string()));
        EXPECT_THAT(error.what(), testing::HasSubstr("games.safetensors"));
    }
}

TEST_F(TrainingEmulator, GamesThatCannotBeReplayedAreNoCrash) {
    eval.episodes = 0;
    ScribeAgent first(1);
    train(first);
    const auto all = list_checkpoints(folder.path());
    fs::remove_all(all.front());
    auto games = load_safetensors(all.back() / "games.safetensors").tensors;
    options.resume = true;
    /// With a manifest to which all of it is right.
    const auto refusal = [&](const TensorMap& bad) {
        auto manifest = read_manifest(all.back());
        save_safetensors(all.back() / "games.safetensors", bad);
        manifest["games.safetensors"] = record_of(all.back() / "games.safetensors");
        write_manifest(all.back(), manifest);
        ScribeAgent second(1);
        return test::error_of<ResumeError>([&] { train(second); });
    };
    for (const auto* part : {"game.0.events", "frames", "episode_returns"}) {
        auto without = games;
        without.erase(part);
        EXPECT_THAT(refusal(without), testing::HasSubstr(part));
    }
    games["game.0.start"] = games["game.0.start"].slice(0, 0, 100).contiguous();
    EXPECT_THAT(refusal(games), testing::HasSubstr("damaged"));
}

TEST_F(TrainingEmulator, TheSameSeedGivesTheSameRunOfSac) {
    at::set_num_threads(1);
    SacConfig config;
    config.network.encoder = EncoderKind::data_efficient;
    config.network.hidden_units = 16;
    config.replay.min_replay = 30;
    config.replay.update_period = 8;
    config.replay.batch_size = 4;
    config.replay.replay_capacity = 1000;
    train_config.total_steps = 260;
    eval.episodes = 0;

    std::vector<std::string> episodes, parameters;
    for (const auto& [seed, overlap] : std::vector<std::pair<std::uint64_t, bool>>{
             {7, false}, {7, false}, {8, false}, {7, true}, {7, true}}) {
        const TemporaryFolder place;
        options.run_dir = place.path();
        train_config.overlap = overlap;
        train_config.seed = static_cast<std::int64_t>(seed);
        AgentSpec spec;
        spec.seed = seed;
        const auto agent = make_sac(config, spec);
        train(*agent);
        episodes.push_back(read_file(place.path() / "episodes.csv"));
        parameters.push_back(read_file(list_checkpoints(place.path()).back() / "agent.safetensors.zst"));
    }
    EXPECT_EQ(episodes[0], episodes[1]);
    EXPECT_TRUE(parameters[0] == parameters[1]) << "parameters, optimisers and generators, bit for bit";
    EXPECT_FALSE(parameters[0] == parameters[2]) << "another seed, another run";
    EXPECT_EQ(episodes[3], episodes[4]);
    EXPECT_TRUE(parameters[3] == parameters[4]) << "overlap is reproducible too";
    EXPECT_FALSE(parameters[0] == parameters[3]) << "but acts with older parameters";
}

}  // namespace
}  // namespace cale
