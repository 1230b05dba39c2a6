// A World of N equal environments, from a class that has the rules of one.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "world/world.h"

namespace cale {

/// N environments that are stepped one after the other. `Game` has
///     explicit Game(std::uint32_t seed)
///     static ActionSpace action_space()
///     static ObservationSpace observation_space()
///     void reset()                                       begins an episode
///     StepResult step(std::int64_t), or
///     StepResult step(std::span<const float>)            as the action space says
///     void draw(std::span<std::uint8_t> frame) const     writes the newest array of the observation
///     void visit_state(Visit&&), for any Visit           calls visit("name", member) for all that the future
///                                                        depends on; members are trivially copyable
template <class Game>
class Environments final : public World {
  public:
    /// One environment for each seed.
    explicit Environments(std::span<const std::uint32_t> seeds) : games_(seeds.begin(), seeds.end()) {}

    std::int64_t size() const override { return std::ssize(games_); }
    ActionSpace action_space() const override { return Game::action_space(); }
    ObservationSpace observation_space() const override { return Game::observation_space(); }

    /// Throws std::invalid_argument where `frames` is not N x frame_size bytes.
    void reset(std::span<std::uint8_t> frames) override {
        require("bytes of frames", frames.size(), games_.size() * frame_size_);
        for (std::size_t i = 0; i < games_.size(); ++i) {
            games_[i].reset();
            games_[i].draw(row(frames, i));
        }
    }

    /// Throws std::invalid_argument, naming the value, for an action that the space does not have.
    void step(const Actions& actions, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) override {
        require("bytes of frames", frames.size(), games_.size() * frame_size_);
        require("bytes of final frames", final_frames.size(), games_.size() * frame_size_);
        require("results", results.size(), games_.size());
        if (std::holds_alternative<std::span<const float>>(actions) != (action_size_ > 0))
            throw std::invalid_argument("the world expects actions of the other kind");
        require("numbers of actions", std::visit([](const auto& all) { return all.size(); }, actions),
                games_.size() * std::max<std::size_t>(1, action_size_));
        std::exception_ptr first;
        for (std::size_t i = 0; i < games_.size(); ++i) {
            auto& game = games_[i];
            try {
                results[i] = step_one(game, actions, i);
                if (results[i].episode_over) {
                    game.draw(row(final_frames, i));
                    game.reset();
                }
                game.draw(row(frames, i));
            } catch (...) {
                if (!first) first = std::current_exception();
            }
        }
        if (first) std::rethrow_exception(first);
    }

    std::vector<EpisodeRecord> record() const override {
        std::vector<EpisodeRecord> records;
        for (auto game : games_) {
            auto& record = records.emplace_back();
            game.visit_state([&](std::string_view name, const auto& member) {
                static_assert(std::is_trivially_copyable_v<std::remove_cvref_t<decltype(member)>>);
                const auto* const bytes = reinterpret_cast<const std::uint8_t*>(&member);
                record[std::string(name)].assign(bytes, bytes + sizeof(member));
            });
        }
        return records;
    }

    void resume(std::span<const EpisodeRecord> records) override {
        auto games = games_;
        if (records.size() != games.size()) {
            throw std::runtime_error("there are " + std::to_string(records.size()) +
                                     " states of environments, not " + std::to_string(games.size()));
        }
        for (std::size_t i = 0; i < games.size(); ++i) {
            games[i].visit_state([&](std::string_view name, auto& member) {
                const auto found = records[i].find(std::string(name));
                if (found == records[i].end() || found->second.size() != sizeof(member))
                    throw std::runtime_error("the state of environment " + std::to_string(i) +
                                             " lacks its '" + std::string(name) + "'");
                std::memcpy(&member, found->second.data(), sizeof(member));
            });
        }
        games_ = std::move(games);
    }

  private:
    static void require(const char* what, std::size_t given, std::size_t expected) {
        if (given != expected)
            throw std::invalid_argument("the world expects " + std::to_string(expected) + ' ' + what +
                                        ", not " + std::to_string(given));
    }

    [[noreturn]] static void refuse(const Box& box, std::size_t axis, float value) {
        std::ostringstream message;
        message.precision(9);
        message << "the action's " << (box.names.empty() ? "axis_" + std::to_string(axis) : box.names[axis])
                << " is " << value << ": it must lie in [" << box.low[axis] << ", " << box.high[axis] << "]";
        throw std::invalid_argument(message.str());
    }

    std::span<std::uint8_t> row(std::span<std::uint8_t> frames, std::size_t i) const {
        return frames.subspan(i * frame_size_, frame_size_);
    }

    StepResult step_one(Game& game, const Actions& actions, std::size_t i) const {
        if constexpr (requires { game.step(std::int64_t{}); }) {
            const auto action = std::get<std::span<const std::int64_t>>(actions)[i];
            if (action < 0 || action >= num_actions(space_))
                throw std::invalid_argument("there is no action " + std::to_string(action) +
                                            ": the world has those from 0 to " +
                                            std::to_string(num_actions(space_) - 1));
            return game.step(action);
        } else {
            const auto action =
                std::get<std::span<const float>>(actions).subspan(i * action_size_, action_size_);
            const auto& box = std::get<Box>(space_);
            for (std::size_t axis = 0; axis < action.size(); ++axis) {
                // Written so that NaN, which compares false to everything, is refused too.
                if (action[axis] >= box.low[axis] && action[axis] <= box.high[axis]) continue;
                refuse(box, axis, action[axis]);
            }
            return game.step(action);
        }
    }

    std::vector<Game> games_;
    // A space holds vectors: too much to make it again in every step.
    ActionSpace space_ = Game::action_space();
    std::size_t action_size_ = static_cast<std::size_t>(box_size(space_));
    std::size_t frame_size_ = static_cast<std::size_t>(Game::observation_space().frame_size());
};

}  // namespace cale
