// SAC learns the pendulum of Gymnasium (Pendulum-v1) from pictures: a task whose score is known. A policy
// that swings it up at once has a return of about -150, one that does nothing or anything at random about
// -1200.
//
//     pendulum [STEPS [SEED]]        prints a CSV: step,return, a row per episode of 200 steps
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <random>
#include <span>

#include <agents/sac.h>
#include <cale/frames.h>
#include <torch/types.h>

namespace {

constexpr int kSide = 32;  // rows and columns of a frame
constexpr int kStack = 3;  // frames of an observation: how fast it turns can be seen from two

// Gymnasium's rules and constants; the torque is how far the joystick is pushed up or down.
class Pendulum {
  public:
    using Frame = std::array<std::uint8_t, kSide * kSide>;

    explicit Pendulum(std::uint32_t seed) : random_(seed) {}

    void reset() {
        angle_ = std::uniform_real_distribution(-std::numbers::pi, std::numbers::pi)(random_);
        speed_ = std::uniform_real_distribution(-1.0, 1.0)(random_);
        steps_ = 0;
    }

    cale::StepResult step(double radius, double theta) {
        constexpr double kTimeStep = 0.05, kGravity = 10, kMaxTorque = 2, kMaxSpeed = 8;
        const double torque = kMaxTorque * radius * std::sin(theta);
        const double from_top = std::remainder(angle_, 2 * std::numbers::pi);
        const double cost = from_top * from_top + 0.1 * speed_ * speed_ + 0.001 * torque * torque;
        speed_ += (1.5 * kGravity * std::sin(angle_) + 3 * torque) * kTimeStep;
        speed_ = std::clamp(speed_, -kMaxSpeed, kMaxSpeed);
        angle_ += speed_ * kTimeStep;
        cale::StepResult result;
        result.reward = static_cast<float>(-cost);
        // Cut off, not terminal: the last state has a value.
        result.truncated = result.episode_over = ++steps_ == 200;
        return result;
    }

    // The rod from the middle, bright where a pixel's centre is near it.
    Frame frame() const {
        constexpr double kMiddle = (kSide - 1) / 2.0, kLength = kSide / 2.0 - 2;
        const double right = std::sin(angle_), up = std::cos(angle_);
        Frame pixels{};
        for (int y = 0; y < kSide; ++y) {
            for (int x = 0; x < kSide; ++x) {
                const double dx = x - kMiddle, dy = kMiddle - y;
                const double along = std::clamp(dx * right + dy * up, 0.0, kLength);
                const double distance = std::hypot(dx - along * right, dy - along * up);
                const double light = std::clamp(2 - distance, 0.0, 1.0);
                pixels[static_cast<std::size_t>(y * kSide + x)] =
                    static_cast<std::uint8_t>(std::lround(255 * light));
            }
        }
        return pixels;
    }

  private:
    std::mt19937 random_;
    double angle_ = 0, speed_ = 0;  // radians from the top, radians a second
    int steps_ = 0;
};

std::unique_ptr<cale::Agent> make_agent(std::int64_t steps, std::uint64_t seed) {
    cale::SacConfig config;
    config.network.encoder = cale::EncoderKind::phi_dqn;
    config.network.hidden_units = 256;
    config.learning_rate = 1e-3;
    config.adam_epsilon = 1e-8;
    config.replay.min_replay = 1'000;
    config.replay.update_period = 1;
    config.replay.batch_size = 64;
    config.replay.replay_capacity = 50'000;
    return cale::make_sac(config, {.num_actions = 0,
                                   .stack = kStack,
                                   .frame_height = kSide,
                                   .frame_width = kSide,
                                   .total_steps = steps,
                                   .seed = seed});
}

}  // namespace

int main(int argc, char** argv) {
    const std::int64_t steps = argc > 1 ? std::atoll(argv[1]) : 20'000;
    const auto seed = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 1);
    if (steps < 1) {
        std::fputs("usage: pendulum [STEPS [SEED]], with STEPS at least 1\n", stderr);
        return 2;
    }
    const auto agent = make_agent(steps, seed);
    Pendulum world(seed);
    cale::FrameStack stack(/*num_envs=*/1, kStack, kSide * kSide);
    const auto begin = [&] {
        world.reset();
        stack.clear(0);
        stack.push(0, world.frame());
    };
    begin();

    const auto observation =
        at::from_blob(const_cast<std::uint8_t*>(stack.data().data()), {1, kStack, kSide, kSide}, at::kByte);
    double episode_return = 0;
    std::printf("step,return\n");
    for (std::int64_t step = 1; step <= steps; ++step) {
        const auto frame = world.frame();
        agent->update(observation);
        const auto actions = agent->act(observation, cale::ActMode::train);
        const auto result = world.step(actions[0][0].item<double>(), actions[0][1].item<double>());
        const auto next_frame = world.frame();
        agent->observe({.frames = frame,
                        .actions = actions,
                        .results = std::span(&result, 1),
                        .final_frames = next_frame});
        stack.push(0, next_frame);
        episode_return += static_cast<double>(result.reward);
        if (!result.episode_over) continue;
        std::printf("%lld,%.1f\n", static_cast<long long>(step), episode_return);
        std::fflush(stdout);
        episode_return = 0;
        begin();
    }
}
