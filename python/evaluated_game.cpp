#include "python/evaluated_game.h"

#include <algorithm>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "cale/frames.h"
#include "cale/games.h"
#include "cale/random_play.h"
#include "cale/seeds.h"

namespace cale::python {

void require_playable(const PolicyInfo& policy, const EnvConfig& env) {
    const auto refuse = [&policy](const std::string& what) {
        throw std::invalid_argument("this policy of " + policy.game + " cannot play there: " + what);
    };
    if (observation_space(env).tensor_shape() != observation_shape(policy))
        refuse("it sees other observations; leave obs and frame_stack as the policy's settings have them");
    const bool continuous = env.action_space == ActionSet::continuous;
    if (continuous != (policy.action_space == "continuous"))
        refuse("it was trained with action_space=" + policy.action_space);
    const bool places_paddle = policy.joystick == Joystick::paddle;
    if (continuous && places_paddle != (env.paddle == Paddle::absolute))
        refuse(places_paddle ? "its actions place a paddle; leave paddle out"
                             : "its actions do not place a paddle; leave paddle out");
    if (const auto joystick = coordinates(env);
        continuous && joystick != policy.joystick &&
        (joystick != written_coordinates(policy) || policy.joystick == Joystick::factored))
        refuse("it was trained with joystick=" + std::string(name_of(policy.joystick)) +
               "; leave joystick out");
    if (continuous) return;
    for (std::int64_t i = 0; i < std::ssize(games_of(env.game)); ++i) {
        const auto own = config_of(env, i);
        const Env game(own, /*seed=*/0);
        if (!std::ranges::equal(game.actions(), policy.actions))
            refuse("it chooses among other joystick events than " + own.game +
                   " has with action_space=" + std::string(name_of(own.action_space)));
    }
}

Joystick written_coordinates(const PolicyInfo& policy) {
    return policy.joystick == Joystick::paddle ? Joystick::paddle : Joystick::polar;
}

PlayedGame play_game(const lite::Policy& policy, const GamePlan& plan, std::int64_t number) {
    Env env(plan.env, derive_seed(plan.seed, "evaluation", number));
    std::mt19937 noise(derive_seed(plan.seed, "evaluation noise", number));
    std::mt19937_64 sampling(derive_seed(plan.seed, "evaluation sample", number));
    auto workspace = policy.workspace();
    const auto seen = observation_space(plan.env);
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(seen.frame_size()));
    FrameStack stack(1, static_cast<std::size_t>(seen.stack), frame.size());
    env.reset(frame);
    stack.push(0, frame);
    PlayedGame game;
    for (StepResult step; !step.episode_over;) {
        if (plan.stop != nullptr && *plan.stop) throw std::runtime_error("the game was stopped");
        const auto choice = plan.sampled ? Choice::sampled : Choice::greedy;
        const auto decision = policy.act(stack.data(), workspace, choice, sampling);
        const bool at_random =
            plan.epsilon > 0 && std::uniform_real_distribution<double>()(noise) < plan.epsilon;
        if (env.actions().empty()) {
            step = env.step(at_random ? random_stick(policy.info().joystick, noise) : decision.stick, frame);
        } else {
            std::uniform_int_distribution<std::int64_t> any(0, std::ssize(env.actions()) - 1);
            step = env.step(at_random ? any(noise) : decision.action, frame);
        }
        stack.follow(0, step, frame);
        game.episode_return += step.reward;
        game.length += 1;
        game.frames += step.frames;
    }
    return game;
}

}  // namespace cale::python
