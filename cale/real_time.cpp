#include "cale/real_time.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <variant>

#include "cale/joystick.h"

namespace cale {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// What the agent does not know yet: up to the end of an episode, or up to now.
struct News {
    StepResult result{};
    Bytes observation{}, final_observation{};
};

/// Adds what a later step brought. Events beyond the room for them are not kept.
void add(StepResult& sum, const StepResult& later) {
    auto both = later;
    both.frame_events = sum.frame_events;
    auto next = static_cast<std::size_t>(sum.frames);
    for (int frame = 0; frame < later.frames && next < both.frame_events.size(); ++frame)
        both.frame_events[next++] = later.frame_events[static_cast<std::size_t>(frame)];
    both.reward += sum.reward;
    both.frames += sum.frames;
    sum = both;
}

void require(bool fits, const char* what) {
    if (!fits) throw std::invalid_argument(std::string("a game in real time: ") + what);
}

/// The action of a world with one game.
FrameAction action_of(const EnvConfig& config, std::span<const Event> events, const Actions& actions) {
    const bool factored = events.empty() && coordinates(config) == Joystick::factored;
    if (const auto* const numbers = std::get_if<std::span<const std::int64_t>>(&actions)) {
        require(factored || !events.empty(), "its action is a joystick's position");
        require(numbers->size() == 1, "it takes one action");
        const auto number = numbers->front();
        if (factored) return factored_stick(number);
        if (number >= 0 && number < std::ssize(events)) return events[static_cast<std::size_t>(number)];
        throw std::out_of_range("there is no action " + std::to_string(number) + " among the " +
                                std::to_string(events.size()) + " discrete actions of this game");
    }
    require(events.empty() && !factored, "its action is a number");
    return stick(coordinates(config), std::get<std::span<const float>>(actions));
}

bool ends_an_episode(const StepResult& result) {
    return result.terminal || result.truncated || result.episode_over;
}

}  // namespace

FrameClock console_clock() {
    using Clock = std::chrono::steady_clock;
    return [due = std::optional<Clock::time_point>()]() mutable -> std::int64_t {
        constexpr auto kFrame = std::chrono::nanoseconds(1'000'000'000 / 60);
        const auto now = Clock::now();
        due = due ? *due + kFrame : now;
        const auto late = (now - *due) / kFrame;
        if (late >= 1) {
            due = now;
            return late;
        }
        std::this_thread::sleep_until(*due);
        return 0;
    };
}

struct RealTimeGame::Impl {
    Impl(const EnvConfig& env_config, std::uint32_t seed, FrameClock frame_clock, Watch watcher)
        : config(env_config),
          env(env_config, seed),
          clock(std::move(frame_clock)),
          watch(std::move(watcher)),
          observation(static_cast<std::size_t>(cale::observation_space(env_config).frame_size())) {}

    ~Impl() {
        {
            const std::lock_guard lock(mutex);
            stopping = true;
        }
        changed.notify_all();
        if (console.joinable()) console.join();
    }

    /// Before each frame, on the console's thread: the action that came since the last one.
    std::optional<FrameAction> next_action() {
        bool after_pause = false;
        {
            std::unique_lock lock(mutex);
            after_pause = paused;
            changed.wait(lock, [this] { return !paused || stopping; });
        }
        const auto late = clock();
        const std::lock_guard lock(mutex);
        if (late < 0) stopping = true;
        if (stopping) throw Stopped();
        if (!after_pause) late_frames += late;
        return std::exchange(command, std::nullopt);
    }

    void run() {
        try {
            while (true) {
                const auto result = env.step([this] { return next_action(); }, observation);
                if (watch) watch(env);
                News latest{.result = result, .observation = observation};
                if (result.episode_over) {
                    latest.final_observation = observation;
                    env.reset(observation);
                    latest.observation = observation;
                }
                publish(std::move(latest));
            }
        } catch (const Stopped&) {
        } catch (...) {
            const std::lock_guard lock(mutex);
            failure = std::current_exception();
        }
        changed.notify_all();
    }

    void publish(News latest) {
        {
            const std::lock_guard lock(mutex);
            if (!news.empty()) missed_frames += latest.result.frames;
            if (news.empty() || ends_an_episode(news.back().result)) {
                news.push_back(std::move(latest));
            } else {
                add(news.back().result, latest.result);
                news.back().observation = std::move(latest.observation);
                news.back().final_observation = std::move(latest.final_observation);
            }
        }
        changed.notify_all();
    }

    /// Waits for news where there is none.
    News take() {
        std::unique_lock lock(mutex);
        changed.wait(lock, [this] { return !news.empty() || failure || stopping; });
        if (!news.empty()) {
            auto oldest = std::move(news.front());
            news.pop_front();
            return oldest;
        }
        if (failure) std::rethrow_exception(failure);
        throw std::runtime_error("the console has stopped");
    }

    struct Stopped {};

    void require_started() const {
        if (first_observation.empty()) throw std::logic_error("no game was started: call reset() first");
    }

    EnvConfig config;
    Env env;  // of the console's thread, once it runs
    FrameClock clock;
    Watch watch;
    Bytes observation;        // the same
    Bytes first_observation;  // of the first game

    mutable std::mutex mutex;  // of all below
    std::condition_variable changed;
    std::optional<FrameAction> command;
    std::deque<News> news;
    std::int64_t missed_frames = 0, late_frames = 0;
    bool paused = false, stopping = false;
    std::exception_ptr failure;

    std::thread console;
    bool announced = false;  // of the agent's thread: what step() will be called with
};

RealTimeGame::RealTimeGame(const EnvConfig& config, std::uint32_t seed, FrameClock clock, Watch watch)
    : impl_(std::make_unique<Impl>(config, seed, std::move(clock), std::move(watch))) {}
RealTimeGame::~RealTimeGame() = default;

ActionSpace RealTimeGame::action_space() const {
    if (impl_->env.actions().empty()) return joystick_space(coordinates(impl_->config));
    return Discrete{std::ssize(impl_->env.actions())};
}
ObservationSpace RealTimeGame::observation_space() const {
    return cale::observation_space(impl_->config);
}

void RealTimeGame::reset(std::span<std::uint8_t> frames) {
    if (impl_->console.joinable()) throw std::logic_error("a console in real time is started once");
    impl_->env.reset(frames);
    impl_->first_observation.assign(frames.begin(), frames.end());
}

void RealTimeGame::announce(const Actions& actions) {
    impl_->require_started();
    const auto action = action_of(impl_->config, impl_->env.actions(), actions);
    {
        const std::lock_guard lock(impl_->mutex);
        impl_->command = action;
    }
    impl_->announced = true;
    if (!impl_->console.joinable()) impl_->console = std::thread([impl = impl_.get()] { impl->run(); });
}

void RealTimeGame::pause(bool paused) {
    {
        const std::lock_guard lock(impl_->mutex);
        impl_->paused = paused;
    }
    impl_->changed.notify_all();
}

void RealTimeGame::step(const Actions& actions, std::span<std::uint8_t> frames,
                        std::span<std::uint8_t> final_frames, std::span<StepResult> results) {
    const auto size = impl_->observation.size();
    require(frames.size() == size && final_frames.size() == size && results.size() == 1,
            "it has one observation and one result");
    if (!impl_->announced) announce(actions);
    impl_->announced = false;
    const auto news = impl_->take();
    std::ranges::copy(news.observation, frames.begin());
    std::ranges::copy(news.final_observation, final_frames.begin());
    results[0] = news.result;
}

std::vector<EpisodeRecord> RealTimeGame::record() const {
    return {{}};
}

void RealTimeGame::resume(std::span<const EpisodeRecord>) {
    impl_->require_started();
    // The game that the caller saw last is cut off; its last observation is the caller's.
    const std::lock_guard lock(impl_->mutex);
    impl_->news.push_front({.result = {.truncated = true, .episode_over = true, .frames = 0},
                            .observation = impl_->first_observation,
                            .final_observation = {}});
}

std::map<std::string, double> RealTimeGame::metrics() const {
    const std::lock_guard lock(impl_->mutex);
    return {{"realtime/missed_frames", static_cast<double>(impl_->missed_frames)},
            {"realtime/late_frames", static_cast<double>(impl_->late_frames)}};
}

}  // namespace cale
