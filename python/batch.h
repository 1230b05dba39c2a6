// N environments as Python's vector environments are: with stacks of frames, the three modes of beginning the
// next episode, seeds and resets of some of them, and their state as bytes. Knows nothing of Python.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "cale/frames.h"
#include "cale/vector_env.h"

namespace cale::python {

/// When the next episode begins: in the step after an episode's last, whose action counts for nothing; in
/// that last step itself; or in reset() alone.
enum class Autoreset { next_step, same_step, disabled };

/// The caller's memory for what a step, or a reset, brings: N of each, row by row.
struct StepArrays {
    std::span<std::uint8_t> observations;  // empty: they are looked at in Batch::stacks()
    std::span<double> rewards;
    std::span<bool> terminated;            // game over, or a life lost where that counts
    std::span<bool> truncated;             // cut off
    std::span<bool> episode_over;          // the game itself is over, or cut off
    std::span<std::int32_t> lives;         // left
    std::span<std::int32_t> frames;        // emulated in the step
    std::span<std::uint8_t> event;         // the joystick event
    std::span<std::uint8_t> frame_events;  // N x frame_skip: what the console saw in each frame
    std::span<double> stick;               // N x 3, x, y and the button; empty: not asked for
    std::span<double> paddle;              // where it is, 0 to 1; empty: not asked for
};

/// Runs one task at a time on a thread of its own.
class Background {
  public:
    Background();
    /// After the task that runs; one that has not begun does not begin any more.
    ~Background();
    Background(const Background&) = delete;
    Background& operator=(const Background&) = delete;

    /// Returns at once. wait() must follow before the next one.
    void start(std::function<void()> task);
    /// Returns when the task has ended. Throws what it threw.
    void wait();

  private:
    void serve();

    std::mutex mutex_;
    std::condition_variable changed_;
    bool busy_ = false, ends_ = false;
    std::function<void()> task_;  // stays where it is while it runs
    std::exception_ptr failure_;
    std::thread thread_;  // the last member: it uses all the others
};

/// One thread at a time may call an object.
class Batch {
  public:
    /// Makes the first environment, so that bad settings are refused at once; all of them follow with the
    /// first reset(). Throws as Env does.
    Batch(const EnvConfig& config, Autoreset autoreset);

    std::int64_t size() const { return config_.num_envs; }               // N
    const EnvConfig& config() const { return config_; }                  // as given
    const ActionSpace& action_space() const { return actions_; }         // of one environment
    const ObservationSpace& observation_space() const { return seen_; }  // the same
    const std::vector<Event>& events() const { return events_; }         // of discrete actions, by number
    /// Whether StepArrays::stick can be asked for: the joystick moves.
    bool has_stick() const;
    /// Whether StepArrays::paddle can be asked for: actions place it.
    bool has_paddle() const;

    /// N x stack x frame_size bytes: the newest observations, overwritten by the next step.
    std::span<const std::uint8_t> stacks() const { return stacks_.data(); }

    /// Begins an episode in each environment that `mask` chooses, and writes what all of them show. An
    /// environment that has a seed is made again. One without it continues with its generators; after the
    /// loss of a life that ended an episode its game continues, unless `new_game`. `seeds`: N; the first
    /// reset needs all of them.
    void reset(std::span<const std::optional<std::uint32_t>> seeds, std::span<const bool> mask, bool new_game,
               const StepArrays& arrays);

    /// One agent step of all. Throws, before any environment has stepped, std::invalid_argument for actions
    /// outside of the space, where they count, and std::logic_error for an environment that must be reset
    /// first; else what an environment throws, after all have finished.
    void step(const Actions& actions, const StepArrays& arrays);

    /// The same on a thread of its own, beside the caller: begin_step() copies the actions and returns;
    /// end_step() returns when `arrays` are written, and throws what step() would.
    void begin_step(const Actions& actions, const StepArrays& arrays);
    void end_step();

    /// Writes what the environment's newest step showed before the next episode began in that same step; row
    /// `index` alone, of the arrays of infos too.
    void write_final(std::int64_t index, std::span<std::uint8_t> observation, const StepArrays& arrays) const;
    /// Writes what all environments show now.
    void write_current(const StepArrays& arrays) const;

    /// Returns all that the future of an environment depends on: its game since its start, and its stack.
    std::string save(std::int64_t index) const;
    /// Continues in these environments, by index, as those would that were saved, wherever that was. Throws
    /// std::invalid_argument for bytes that are none of save() or of another game or other settings, before
    /// anything has changed, and std::runtime_error for a game that is damaged; its environment must then be
    /// reset.
    void restore(const std::map<std::int64_t, std::string_view>& saved);

    /// Ends the environments and their threads, after the step that is under way; stacks() stay. Nothing but
    /// is_closed() and stacks() may be called any more.
    void close();
    bool is_closed() const { return closed_; }  // whether close() was called

    /// For pictures, memory and frame numbers. Throws std::logic_error before the first reset().
    const Env& env(std::int64_t index) const;

  private:
    struct Shown {
        StepResult result;
        StickPosition stick;
        double paddle = 0;
    };
    struct Saved;
    void make(std::span<const std::uint32_t> seeds);
    void begin_episode(std::size_t i, bool new_game);
    void step_one(std::size_t i, const Actions& actions, const StepArrays& arrays);
    bool begins(std::size_t i) const;
    void check(const Actions& actions) const;
    Saved parsed(std::int64_t index, std::string_view saved) const;
    Shown shown(std::size_t i, const StepResult& result) const;
    Shown at_start(std::size_t i) const;
    void write_infos(std::size_t i, const Shown& shown, const StepArrays& arrays) const;
    void write_observation(std::size_t i, std::span<std::uint8_t> observations) const;
    std::span<std::uint8_t> frame(std::size_t i) {
        return std::span(frames_).subspan(i * frame_size_, frame_size_);
    }
    VectorEnv& envs() const;

    EnvConfig config_;
    Autoreset autoreset_;
    ActionSpace actions_;
    std::vector<Event> events_;
    ObservationSpace seen_;
    std::size_t frame_size_;  // bytes
    std::size_t stack_size_;  // bytes of an observation
    FrameStack stacks_;
    std::vector<std::uint8_t> frames_;        // N x frame_size: the newest
    std::vector<std::uint8_t> final_stacks_;  // as stacks_, of episodes that ended in the newest step
    std::vector<Shown> newest_;               // by the newest step, before the next episode began in it
    struct State {
        bool ended = false;        // the agent's episode; a new one has not begun
        bool must_restart = true;  // with a new game
    };
    std::vector<State> states_;
    std::unique_ptr<VectorEnv> envs_;  // none before the first reset()
    bool closed_ = false;

    std::vector<float> sent_coordinates_;
    std::vector<std::int64_t> sent_numbers_;
    std::unique_ptr<Background> background_;  // the last member: its task uses all the others
};

}  // namespace cale::python
