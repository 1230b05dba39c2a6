// A world of one's own, learned by an agent of ours. An agent knows nothing of ALE: it is told frames,
// rewards and ends, and this loop is all that a world needs.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <random>
#include <span>
#include <string_view>

#include <agents/dqn.h>
#include <cale/frames.h>
#include <torch/types.h>

namespace {

constexpr int kSide = 12;  // rows and columns of a frame
constexpr int kStack = 2;  // frames of an observation

// A ball falls; the bat at the bottom, three pixels wide, should be where it lands.
class Catch {
  public:
    using Frame = std::array<std::uint8_t, kSide * kSide>;
    static constexpr int kActions = 3;  // left, stay, right

    void reset() {
        row_ = 0;
        column_ = std::uniform_int_distribution(0, kSide - 1)(random_);
        bat_ = kSide / 2;
    }
    cale::StepResult step(std::int64_t action) {
        bat_ = std::clamp(bat_ + static_cast<int>(action) - 1, 1, kSide - 2);
        const bool over = ++row_ == kSide - 1;
        const bool caught = std::abs(bat_ - column_) <= 1;
        cale::StepResult result;
        if (over) result.reward = caught ? 1.0F : -1.0F;
        result.terminal = result.episode_over = over;
        return result;
    }
    Frame frame() const {
        Frame pixels{};
        pixels[static_cast<std::size_t>(row_ * kSide + column_)] = 255;
        for (int x = bat_ - 1; x <= bat_ + 1; ++x)
            pixels[static_cast<std::size_t>((kSide - 1) * kSide + x)] = 255;
        return pixels;
    }

  private:
    std::mt19937 random_{1};
    int row_ = 0, column_ = 0, bat_ = 0;
};

std::unique_ptr<cale::Agent> make_agent(std::int64_t steps) {
    cale::DqnConfig config;
    config.hidden_units = 64;
    config.learning_rate = 1e-3;
    config.target_update_period = 100;
    config.replay.min_replay = 200;
    config.replay.update_period = 2;
    config.replay.replay_capacity = 5'000;
    config.epsilon.epsilon_decay_period = steps / 2;
    return cale::make_dqn(config, {.num_actions = Catch::kActions,
                                   .stack = kStack,
                                   .frame_height = kSide,
                                   .frame_width = kSide,
                                   .total_steps = steps,
                                   .seed = 1});
}

}  // namespace

int main(int argc, char** argv) {
    if (argc > 1) {
        const bool asked = std::string_view(argv[1]) == "--help";
        std::fputs("usage: custom_environment\n", asked ? stdout : stderr);
        return asked ? 0 : 2;
    }
    constexpr std::int64_t kSteps = 3'000;
    const auto agent = make_agent(kSteps);
    Catch world;
    cale::FrameStack stack(/*num_envs=*/1, kStack, kSide * kSide);
    const auto begin = [&] {
        world.reset();
        stack.clear(0);
        stack.push(0, world.frame());
    };
    begin();

    // What the agent sees: a view of the stack.
    const auto observation =
        at::from_blob(const_cast<std::uint8_t*>(stack.data().data()), {1, kStack, kSide, kSide}, at::kByte);
    double newest_mean = 0;  // of the returns, over about a hundred episodes
    for (std::int64_t step = 1; step <= kSteps; ++step) {
        const auto frame = world.frame();
        agent->update(observation);
        const auto actions = agent->act(observation, cale::ActMode::train);
        const auto result = world.step(actions.item<std::int64_t>());
        const auto next_frame = world.frame();
        agent->observe({.frames = frame,
                        .actions = actions,
                        .results = std::span(&result, 1),
                        .final_frames = next_frame});
        stack.push(0, next_frame);
        if (result.episode_over) {
            newest_mean += (result.reward - newest_mean) / 100;
            begin();
        }
        if (step % 1'000 == 0) std::printf("step %ld  return %.2f\n", static_cast<long>(step), newest_mean);
    }

    int caught = 0;
    constexpr int kGames = 100;
    for (int game = 0; game < kGames; ++game) {
        begin();
        for (cale::StepResult result; !result.episode_over;) {
            result = world.step(agent->act(observation, cale::ActMode::evaluate).item<std::int64_t>());
            stack.push(0, world.frame());
            caught += result.reward > 0;
        }
    }
    std::printf("%d of %d balls caught\n", caught, kGames);
    return caught > kGames / 2 ? 0 : 1;  // by chance it would be a quarter
}
