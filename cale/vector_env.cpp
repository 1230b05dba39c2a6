#include "cale/vector_env.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <exception>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include "cale/cores.h"

namespace cale {
namespace {

// The emulator, its ROM and frames: 0.88 MB each (bench/env_speed with 1 and with 33 of them).
constexpr std::int64_t kBytesOfEnv = 1'000'000;
constexpr std::int64_t kBytesOfScreen = std::int64_t{210} * 160;

// A fixed number of threads that do one task together, again and again. The caller's is one of them, so that
// one fewer has to be woken.
class ThreadTeam {
  public:
    explicit ThreadTeam(int size) : size_(size) {
        try {
            for (int member = 1; member < size; ++member)
                threads_.emplace_back([this, member] { serve(member); });
        } catch (...) {
            dismiss();
            throw;
        }
    }
    ~ThreadTeam() { dismiss(); }
    ThreadTeam(const ThreadTeam&) = delete;
    ThreadTeam& operator=(const ThreadTeam&) = delete;

    int size() const { return size_; }

    // Calls task(0) ... task(size - 1), each on its thread, and returns when all have.
    // The task must not throw.
    void run(const std::function<void(int)>& task) {
        task_ = &task;
        busy_.store(size_ - 1, std::memory_order_relaxed);
        next_round();
        task(0);
        for (int busy = 0; (busy = busy_.load(std::memory_order_acquire)) != 0;) busy_.wait(busy);
    }

  private:
    void next_round() {
        round_.fetch_add(1, std::memory_order_release);
        round_.notify_all();
    }

    void dismiss() {
        task_ = nullptr;
        next_round();
        threads_.clear();
    }

    void serve(int member) {
        for (unsigned seen = 0;; ++seen) {
            round_.wait(seen, std::memory_order_acquire);
            if (task_ == nullptr) return;
            (*task_)(member);
            if (busy_.fetch_sub(1, std::memory_order_acq_rel) == 1) busy_.notify_one();
        }
    }

    int size_;
    const std::function<void(int)>* task_ = nullptr;
    std::atomic<unsigned> round_{0};
    std::atomic<int> busy_{0};
    std::vector<std::jthread> threads_;
};

void require_size(std::size_t size, std::size_t expected, const char* what) {
    if (size == expected) return;
    throw std::invalid_argument(std::string(what) + ": " + std::to_string(size) + " given, " +
                                std::to_string(expected) + " needed");
}

template <class T>
std::vector<std::uint8_t> bytes_of(std::span<const T> values) {
    const auto bytes = std::as_bytes(values);
    const auto* const begin = reinterpret_cast<const std::uint8_t*>(bytes.data());
    return {begin, begin + bytes.size()};
}

// The bytes called `name` as the values that they were made of: a string, or a vector of numbers.
template <class Values>
void read_bytes(const EpisodeRecord& record, const std::string& name, Values& values) {
    const auto found = record.find(name);
    if (found == record.end() || found->second.size() % sizeof(values[0]) != 0)
        throw std::runtime_error("a recorded game lacks its '" + name + "'");
    values.resize(found->second.size() / sizeof(values[0]));
    if (!values.empty()) std::memcpy(values.data(), found->second.data(), found->second.size());
}

/// Whether the environment's games are recorded as commands, not as events.
bool records_commands(const Env& env) {
    return env.stick() || env.paddle();
}

}  // namespace

struct VectorEnv::Impl {
    Impl(const EnvConfig& env_config, std::span<const std::uint32_t> seeds)
        : config(env_config),
          joystick(coordinates(config)),
          frame_size(static_cast<std::size_t>(cale::observation_space(config).frame_size())),
          observation_space(cale::observation_space(config)),
          envs(seeds.size()),
          errors(seeds.size()),
          team(static_cast<int>(threads(config))),
          shares(static_cast<std::size_t>(team.size())) {
        for_each_env([&](std::size_t i) {
            envs[i].emplace(config_of(config, static_cast<std::int64_t>(i)), seeds[i]);
        });
    }

    // Calls work(i) for every environment. Each has a thread whose caches know it; a thread that is done with
    // its own helps the others, which may have slower cores or games to start. When all are done, throws what
    // the first of those that threw had thrown.
    template <class Work>
    void for_each_env(const Work& work) {
        const auto members = shares.size();
        for (std::size_t m = 0; m < members; ++m) shares[m].next = envs.size() * m / members;
        const auto share = [&](int member) {
            for (std::size_t k = 0; k < members; ++k) {
                const auto m = (static_cast<std::size_t>(member) + k) % members;
                const auto end = envs.size() * (m + 1) / members;
                for (std::size_t i = 0; (i = shares[m].next.fetch_add(1, std::memory_order_relaxed)) < end;) {
                    try {
                        work(i);
                    } catch (...) {
                        errors[i] = std::current_exception();
                    }
                }
            }
        };
        team.run(std::cref(share));  // by reference, so that std::function need not allocate

        std::exception_ptr first;
        for (auto& error : errors) {
            auto thrown = std::exchange(error, nullptr);
            if (first == nullptr) first = std::move(thrown);
        }
        if (first != nullptr) std::rethrow_exception(first);
    }

    /// `step_one` takes the step of environment i.
    template <class StepOne>
    void step(StepOne&& step_one, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) {
        require_size(frames.size(), envs.size() * frame_size, "bytes for the frames");
        require_size(final_frames.size(), envs.size() * frame_size, "bytes for the final frames");
        require_size(results.size(), envs.size(), "step results");
        for_each_env([&](std::size_t i) {
            const auto frame = frames.subspan(i * frame_size, frame_size);
            results[i] = step_one(i, frame);
            if (!results[i].episode_over) return;
            std::ranges::copy(frame, final_frames.subspan(i * frame_size, frame_size).begin());
            envs[i]->reset(frame);
        });
    }

    EnvConfig config;
    Joystick joystick;
    std::size_t frame_size;  // bytes
    ObservationSpace observation_space;
    std::vector<std::optional<Env>> envs;  // empty only until their threads have made them
    std::vector<std::exception_ptr> errors;
    ThreadTeam team;
    struct alignas(64) Share {
        std::atomic<std::size_t> next = 0;  // the first of its environments that no thread has taken yet
    };
    std::vector<Share> shares;
};

VectorEnv::VectorEnv(const EnvConfig& config, std::span<const std::uint32_t> seeds) {
    if (config.num_envs < 1)
        throw std::invalid_argument("env.num_envs is " + std::to_string(config.num_envs) +
                                    ": it must be at least 1");
    cale::action_space(config);  // throws for games that do not go together
    require_size(seeds.size(), static_cast<std::size_t>(config.num_envs), "seeds of environments");
    impl_ = std::make_unique<Impl>(config, seeds);
}
VectorEnv::~VectorEnv() = default;
VectorEnv::VectorEnv(VectorEnv&&) noexcept = default;
VectorEnv& VectorEnv::operator=(VectorEnv&&) noexcept = default;

std::int64_t VectorEnv::threads(const EnvConfig& config) {
    const std::int64_t wanted = config.env_threads > 0 ? config.env_threads : core_count();
    return std::clamp<std::int64_t>(wanted, 1, std::max<std::int64_t>(1, config.num_envs));
}

std::int64_t VectorEnv::memory_per_env(const EnvConfig& config) {
    const auto seen = config.obs == Obs::ram ? std::int64_t{kRamSize} : kBytesOfScreen;
    return kBytesOfEnv + config.motion.observation_latency.high * seen;
}

std::int64_t VectorEnv::size() const {
    return std::ssize(impl_->envs);
}
std::span<const Event> VectorEnv::actions() const {
    return impl_->envs.front()->actions();
}
const Env& VectorEnv::env(std::int64_t index) const {
    return *impl_->envs.at(static_cast<std::size_t>(index));
}

ActionSpace VectorEnv::action_space() const {
    if (actions().empty()) return joystick_space(impl_->joystick);
    return Discrete{std::ssize(actions())};
}
ObservationSpace VectorEnv::observation_space() const {
    return impl_->observation_space;
}

EpisodeRecord VectorEnv::record(std::int64_t index) const {
    const Env& env = this->env(index);
    const auto& game = env.record();
    EpisodeRecord record;
    record["start"] = bytes_of(std::span(game.start));
    record["events"] = bytes_of(std::span(game.events));
    record["strengths"] = bytes_of(std::span(game.strengths));
    if (records_commands(env)) record["commands"] = bytes_of(std::span(game.commands));
    return record;
}
std::vector<EpisodeRecord> VectorEnv::record() const {
    std::vector<EpisodeRecord> records;
    for (std::int64_t i = 0; i < size(); ++i) records.push_back(record(i));
    return records;
}

void VectorEnv::resume(std::int64_t index, const EpisodeRecord& record) {
    Env& env = *impl_->envs.at(static_cast<std::size_t>(index));
    GameRecord game;
    read_bytes(record, "start", game.start);
    read_bytes(record, "events", game.events);
    read_bytes(record, "strengths", game.strengths);
    if (records_commands(env)) read_bytes(record, "commands", game.commands);
    env.resume(game);
}
void VectorEnv::resume(std::span<const EpisodeRecord> records) {
    require_size(records.size(), impl_->envs.size(), "recorded games");
    impl_->for_each_env([&](std::size_t i) { resume(static_cast<std::int64_t>(i), records[i]); });
}

void VectorEnv::for_each(const std::function<void(std::int64_t index)>& work) {
    impl_->for_each_env([&work](std::size_t i) { work(static_cast<std::int64_t>(i)); });
}
void VectorEnv::reset(std::int64_t index, std::span<std::uint8_t> frame) {
    impl_->envs.at(static_cast<std::size_t>(index))->reset(frame);
}
void VectorEnv::renew(std::int64_t index, std::uint32_t seed) {
    // First made, then put there: where it cannot be made, the old one stays.
    impl_->envs.at(static_cast<std::size_t>(index)) = Env(config_of(impl_->config, index), seed);
}

void VectorEnv::reset(std::span<std::uint8_t> frames) {
    require_size(frames.size(), impl_->envs.size() * impl_->frame_size, "bytes for the frames");
    impl_->for_each_env([&](std::size_t i) {
        impl_->envs[i]->reset(frames.subspan(i * impl_->frame_size, impl_->frame_size));
    });
}

void VectorEnv::step(std::span<const ContinuousAction> actions, std::span<std::uint8_t> frames,
                     std::span<std::uint8_t> final_frames, std::span<StepResult> results) {
    require_size(actions.size(), impl_->envs.size(), "actions");
    impl_->step(
        [&](std::size_t i, std::span<std::uint8_t> frame) { return impl_->envs[i]->step(actions[i], frame); },
        frames, final_frames, results);
}

void VectorEnv::check(const Actions& actions) const {
    const auto* const numbers = std::get_if<std::span<const std::int64_t>>(&actions);
    const bool takes_numbers = !this->actions().empty() || impl_->joystick == Joystick::factored;
    if ((numbers != nullptr) != takes_numbers) {
        throw std::invalid_argument(
            numbers != nullptr ? "this world's actions are coordinates of the joystick, not numbers"
                               : "this world's actions are numbers, not coordinates of the joystick");
    }
    const auto count = impl_->envs.size();
    if (numbers != nullptr) return require_size(numbers->size(), count, "actions");
    const auto size = stick_coordinates(impl_->joystick).size();
    require_size(std::get<std::span<const float>>(actions).size(), size * count, "coordinates of actions");
}

StepResult VectorEnv::step(std::int64_t index, const Actions& actions, std::span<std::uint8_t> frame) {
    const auto i = static_cast<std::size_t>(index);
    Env& env = *impl_->envs.at(i);
    if (const auto* const numbers = std::get_if<std::span<const std::int64_t>>(&actions)) {
        if (!env.actions().empty()) return env.step((*numbers)[i], frame);
        return env.step(factored_stick((*numbers)[i]), frame);
    }
    const auto size = stick_coordinates(impl_->joystick).size();
    const auto coordinates = std::get<std::span<const float>>(actions).subspan(i * size, size);
    return env.step(stick(impl_->joystick, coordinates), frame);
}

void VectorEnv::step(const Actions& actions, std::span<std::uint8_t> frames,
                     std::span<std::uint8_t> final_frames, std::span<StepResult> results) {
    check(actions);
    impl_->step(
        [&](std::size_t i, std::span<std::uint8_t> frame) {
            return step(static_cast<std::int64_t>(i), actions, frame);
        },
        frames, final_frames, results);
}

}  // namespace cale
