#include "experiment/evaluation.h"

#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <torch/torch.h>

#include "cale/frames.h"
#include "experiment/files.h"
#include "experiment/seeds.h"
#include "report/scene.h"
#include "report/video.h"

namespace cale {

namespace {

/// Films a game, one picture per agent step, at the game's own pace: its first five minutes,
/// as a picture costs more than a step and a game may last half an hour.
class Film {
  public:
    Film(std::filesystem::path path, const EnvConfig& env)
        : path_(std::move(path)),
          pictures_per_second_(60.0 / static_cast<double>(env.frame_skip)),
          threshold_(env.threshold) {}

    void shoot(const Env& env, std::span<const std::uint8_t> observation,
               std::optional<ContinuousAction> action, Event event, double episode_return) {
        if (++pictures_ > 5 * 60 * pictures_per_second_) return;
        env.screen_rgb(pixels_);
        const Image image = compose_frame({.screen = pixels_,
                                           .screen_width = env.screen_width(),
                                           .screen_height = env.screen_height(),
                                           .observation = observation,
                                           .action = action,
                                           .threshold = threshold_,
                                           .event = event,
                                           .episode_return = episode_return});
        if (!writer_) writer_.emplace(path_, image.width, image.height, pictures_per_second_, 1);
        writer_->write(image.rgb);
    }
    void finish() { writer_->close(); }

  private:
    std::filesystem::path path_;
    double pictures_per_second_;
    double threshold_;
    double pictures_ = 0;
    std::optional<VideoWriter> writer_;
    std::vector<std::uint8_t> pixels_;
};

EvaluatedGame play(Agent& agent, Env& env, std::size_t stack_depth, Film* film,
                   std::array<std::int64_t, kEventCount>& events) {
    FrameStack stack(1, stack_depth);
    std::vector<std::uint8_t> frame(kFrameSize);
    env.reset(frame);
    stack.push(0, frame);
    EvaluatedGame game;
    for (StepResult result; !result.episode_over;) {
        const auto chosen = agent.act(stack_tensor(stack, 1, stack_depth), ActMode::evaluate).contiguous();
        std::optional<ContinuousAction> action;
        if (env.actions().empty()) {
            const float* a = chosen.const_data_ptr<float>();
            action = ContinuousAction{a[0], a[1], a[2]};
            result = env.step(*action, frame);
        } else {
            result = env.step(chosen.const_data_ptr<std::int64_t>()[0], frame);
        }
        if (result.terminal || result.truncated) stack.clear(0);
        stack.push(0, frame);
        ++events[static_cast<std::size_t>(result.event)];
        game.episode_return += result.reward;
        game.length += 1;
        game.frames += result.frames;
        if (film != nullptr) film->shoot(env, frame, action, result.event, game.episode_return);
    }
    return game;
}

}  // namespace

torch::Tensor stack_tensor(const FrameStack& stack, std::size_t num_envs, std::size_t depth) {
    // LibTorch knows no constant tensors: nobody writes through this one.
    return torch::from_blob(
        const_cast<std::uint8_t*>(stack.data().data()),
        {static_cast<std::int64_t>(num_envs), static_cast<std::int64_t>(depth), kFrameHeight, kFrameWidth},
        torch::kUInt8);
}

Evaluation evaluate(Agent& agent, EnvConfig env_config, const EvalConfig& config, std::uint64_t seed,
                    std::size_t stack_depth, const std::filesystem::path& video) {
    env_config.noop_max = config.noop_max;
    Evaluation evaluation;
    for (std::int64_t i = 0; i < config.episodes; ++i) {
        Env env(env_config, derive_seed(seed, "evaluation", i));
        std::optional<Film> film;
        if (i == 0 && !video.empty()) film.emplace(video, env_config);
        evaluation.games.push_back(play(agent, env, stack_depth, film ? &*film : nullptr, evaluation.events));
        if (film) film->finish();
    }
    const auto n = static_cast<double>(evaluation.games.size());
    for (const auto& game : evaluation.games) evaluation.mean_return += game.episode_return / n;
    double variance = 0;
    for (const auto& game : evaluation.games) {
        variance += std::pow(game.episode_return - evaluation.mean_return, 2) / n;
    }
    evaluation.standard_deviation = std::sqrt(variance);
    return evaluation;
}

void write_evaluation(const std::filesystem::path& csv, const Evaluation& evaluation) {
    std::string text = "episode,return,length,frames\n";
    for (std::size_t i = 0; i < evaluation.games.size(); ++i) {
        const auto& game = evaluation.games[i];
        text += fmt::format("{},{},{},{}\n", i, game.episode_return, game.length, game.frames);
    }
    std::filesystem::create_directories(csv.parent_path());
    write_file_atomically(csv, text);
}

}  // namespace cale
