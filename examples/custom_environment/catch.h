// A world of one's own: a ball falls; the bat at the bottom, three pixels wide, should be where it lands.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <random>
#include <span>
#include <string>

#include <cale/fields.h>
#include <world/environments.h>

namespace example {

class Catch {
  public:
    static constexpr int kSide = 12;  // rows and columns of a frame

    explicit Catch(std::uint32_t seed) : random_(seed) {}

    static cale::ActionSpace action_space() { return cale::Discrete{3}; }  // left, stay, right
    static cale::ObservationSpace observation_space() { return {.stack = 2, .shape = {kSide, kSide}}; }

    void reset() {
        row_ = 0;
        column_ = static_cast<int>(random_() % kSide);
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
    void draw(std::span<std::uint8_t> frame) const {
        std::ranges::fill(frame, std::uint8_t{0});
        frame[static_cast<std::size_t>(row_ * kSide + column_)] = 255;
        for (int x = bat_ - 1; x <= bat_ + 1; ++x)
            frame[static_cast<std::size_t>((kSide - 1) * kSide + x)] = 255;
    }

    // What a checkpoint holds of it.
    template <class Visit>
    void visit_state(Visit&& visit) {
        visit("random", random_);
        visit("row", row_);
        visit("column", column_);
        visit("bat", bat_);
    }

  private:
    std::mt19937 random_;
    int row_ = 0, column_ = 0, bat_ = 0;
};

// Section env of the configuration.
struct CatchConfig {
    std::int64_t num_envs = 1;
};

template <class Visit>
void fields(CatchConfig& config, Visit&& visit) {
    visit("num_envs", config.num_envs, cale::Range{1, 1024}, "environments that step together");
}

// The functions that the training programs require of a world: see train/training_world.h.
inline std::string world_name(const CatchConfig&) {
    return "Catch";
}
inline cale::ActionSpace action_space(const CatchConfig&) {
    return Catch::action_space();
}
inline cale::ObservationSpace observation_space(const CatchConfig&) {
    return Catch::observation_space();
}
inline std::unique_ptr<cale::World> make_world(const CatchConfig&, std::span<const std::uint32_t> seeds) {
    return std::make_unique<cale::Environments<Catch>>(seeds);
}

}  // namespace example
