// Turns the emulator's screens into observations: the pixelwise maximum of two screens, in gray, 84x84 (Mnih
// et al. 2015), bit for bit as Dopamine makes them with OpenCV, and stacks of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "world/step_result.h"

namespace cale {

inline constexpr int kFrameHeight = 84;  // rows of what an agent sees
inline constexpr int kFrameWidth = 84;   // columns
inline constexpr std::size_t kFrameSize = std::size_t{kFrameHeight} * kFrameWidth;  // bytes
inline constexpr std::size_t kRamSize = 128;  // bytes of the console's memory
/// Every Atari 2600 screen has 160 columns; the number of rows depends on the game.
inline constexpr int kScreenWidth = 160;

/// One output pixel of an area resize along one axis: the sum of weights[i] * source[first + i].
struct AreaCell {
    int first = 0;               // source pixel
    std::vector<float> weights;  // of that one and those after it; their sum is 1
};

/// The cells that shrink `source` pixels to `target`, as cv::resize with INTER_AREA has them.
std::vector<AreaCell> area_cells(int source, int target);

/// Pools and shrinks the last two screens of an agent step. Both are remembered, so that
/// a step which ends before it has shown two screens still sees those of the step before.
class FramePipeline {
  public:
    /// For screens of `screen_height` rows by kScreenWidth columns of indices into `gray`.
    /// Throws std::invalid_argument if index 0 is not black, and for less than a frame's rows or over 1024.
    FramePipeline(int screen_height, const std::array<std::uint8_t, 256>& gray);

    /// Must be called with the first screen of a game, which is pooled with black. Throws, as the functions
    /// below do, std::invalid_argument for another size.
    void start(std::span<const std::uint8_t> screen);
    /// The last screen but one of a step; the last, where it shows only one.
    void set_first(std::span<const std::uint8_t> screen) { set(0, screen); }
    /// The last screen of a step, where it shows more than one.
    void set_second(std::span<const std::uint8_t> screen) { set(1, screen); }

    /// Writes the brighter of the two screens, pixel by pixel, shrunk to kFrameSize bytes.
    void write(std::span<std::uint8_t> frame);

  private:
    // The four quarters of a row shrink by the same pattern: they are the lanes of a vector.
    static constexpr std::size_t kLanes = 4;
    static constexpr std::size_t kRowSteps = kScreenWidth / kLanes;
    static constexpr std::size_t kNarrowSteps = kFrameWidth / kLanes;
    using Lanes [[gnu::vector_size(16)]] = float;
    // The column i of each quarter: a cell of 160/84 columns touches three at most.
    struct Column {
        std::size_t first = 0;
        std::array<Lanes, 3> weights{};
    };

    void set(int which, std::span<const std::uint8_t> screen);
    void narrow_row(std::size_t row);
    void shorten_rows(std::size_t frame_row);

    std::array<float, 256> gray_;
    std::size_t height_;
    std::array<std::vector<std::uint8_t>, 2> screens_;
    // Most rows are the same from step to step. Only those that changed pass through the resize;
    // the others' results are still there.
    std::vector<std::uint8_t> changed_;  // by screen row
    std::vector<Lanes> narrow_;          // screen_height x kNarrowSteps
    std::array<std::uint8_t, kFrameSize> frame_{};

    std::array<Column, kNarrowSteps> columns_;
    std::vector<AreaCell> row_cells_;
};

/// The last `depth` frames of N environments, newest last: the input of a network that acts.
/// All zero until frames are pushed, as at the start of every episode.
class FrameStack {
  public:
    /// For `num_envs` environments, `depth` frames of `frame_size` bytes each. Throws std::invalid_argument
    /// for a 0.
    FrameStack(std::size_t num_envs, std::size_t depth, std::size_t frame_size = kFrameSize);

    /// Drops the oldest frame of an environment and appends `frame`.
    /// Throws std::invalid_argument for a frame of another size, std::out_of_range for `env`.
    void push(std::size_t env, std::span<const std::uint8_t> frame);
    /// Sets the environment's stack to zero. Must be called when an episode begins. Throws std::out_of_range.
    void clear(std::size_t env);
    /// Appends what the environment shows after a step: the first frame of a new episode if the step ended
    /// one. Throws as push() does.
    void follow(std::size_t env, const StepResult& result, std::span<const std::uint8_t> frame);

    /// num_envs x depth x frame_size bytes.
    std::span<const std::uint8_t> data() const { return data_; }
    /// Replaces the contents. Throws std::invalid_argument for another size.
    void assign(std::span<const std::uint8_t> data);

  private:
    std::span<std::uint8_t> stack_of(std::size_t env);

    std::size_t num_envs_;
    std::size_t depth_;
    std::size_t frame_size_;
    std::vector<std::uint8_t> data_;
};

}  // namespace cale
