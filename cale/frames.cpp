#include "cale/frames.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace cale {
namespace {

constexpr std::size_t kRow = kScreenWidth;

// Rounds 0 <= value < 2^22 half to even, in a way that vectorises everywhere: where a float's
// last bit is worth one, adding is rounding.
std::uint8_t round_to_byte(float value) {
    constexpr float kOneIsLastBit = 0x1.8p23f;
    return static_cast<std::uint8_t>(std::bit_cast<std::uint32_t>(value + kOneIsLastBit));
}

constexpr int kMostRows = 1024;  // of a screen: no console has half as many

void require_size(std::size_t size, std::size_t expected, const char* what) {
    if (size == expected) return;
    throw std::invalid_argument(std::string(what) + " has " + std::to_string(size) + " bytes: it must have " +
                                std::to_string(expected));
}

}  // namespace

std::vector<AreaCell> area_cells(int source, int target) {
    constexpr double kNegligible = 1e-3;
    const double scale = static_cast<double>(source) / target;
    std::vector<AreaCell> cells;
    for (int k = 0; k < target; ++k) {
        const double begin = k * scale;
        const double end = begin + scale;
        const double width = std::min(scale, source - begin);
        const int last = std::min(static_cast<int>(std::floor(end)), source - 1);
        const int whole = std::min(static_cast<int>(std::ceil(begin)), last);

        AreaCell cell{whole, {}};
        if (whole - begin > kNegligible) {
            cell.first = whole - 1;
            cell.weights.push_back(static_cast<float>((whole - begin) / width));
        }
        for (int i = whole; i < last; ++i) cell.weights.push_back(static_cast<float>(1.0 / width));
        if (end - last > kNegligible) {
            cell.weights.push_back(static_cast<float>(std::min({end - last, 1.0, width}) / width));
        }
        cells.push_back(cell);
    }
    return cells;
}

FramePipeline::FramePipeline(int screen_height, const std::array<std::uint8_t, 256>& gray)
    : height_(static_cast<std::size_t>(screen_height)) {
    if (gray[0] != 0) throw std::invalid_argument("colour 0 of the gray palette must be black");
    if (screen_height < kFrameHeight) {
        throw std::invalid_argument("a screen of " + std::to_string(screen_height) +
                                    " rows cannot be shrunk to " + std::to_string(kFrameHeight));
    }
    if (screen_height > kMostRows) {
        throw std::invalid_argument("a screen of " + std::to_string(screen_height) +
                                    " rows is no console's: it may have up to " + std::to_string(kMostRows));
    }
    std::ranges::copy(gray, gray_.begin());
    screens_.fill(std::vector<std::uint8_t>(height_ * kRow));
    changed_.assign(height_, true);
    narrow_.resize(height_ * kNarrowSteps);
    row_cells_ = area_cells(screen_height, kFrameHeight);

    const auto cells = area_cells(kScreenWidth, kFrameWidth);
    for (std::size_t i = 0; i < kNarrowSteps; ++i) {
        Column& column = columns_[i];
        column.first = std::min(static_cast<std::size_t>(cells[i].first), kRowSteps - column.weights.size());
        for (std::size_t q = 0; q < kLanes; ++q) {
            const AreaCell& cell = cells[q * kNarrowSteps + i];
            const std::size_t skipped = static_cast<std::size_t>(cell.first) - q * kRowSteps - column.first;
            for (std::size_t tap = 0; tap < cell.weights.size(); ++tap) {
                column.weights.at(skipped + tap)[q] = cell.weights[tap];
            }
        }
    }
}

void FramePipeline::start(std::span<const std::uint8_t> screen) {
    set(0, screen);
    std::ranges::fill(screens_[1], std::uint8_t{0});
    std::ranges::fill(changed_, std::uint8_t{true});
}

void FramePipeline::set(int which, std::span<const std::uint8_t> screen) {
    auto& kept = screens_[static_cast<std::size_t>(which)];
    require_size(screen.size(), kept.size(), "a screen");
    for (std::size_t row = 0; row < height_; ++row) {
        const std::uint8_t* const from = &screen[row * kRow];
        std::uint8_t* const to = &kept[row * kRow];
        if (std::memcmp(to, from, kRow) == 0) continue;
        std::memcpy(to, from, kRow);
        changed_[row] = true;
    }
}

// Gray, brighter of the two, and the horizontal pass of the resize.
void FramePipeline::narrow_row(std::size_t row) {
    const std::uint8_t* const first = &screens_[0][row * kRow];
    const std::uint8_t* const second = &screens_[1][row * kRow];
    const auto brighter = [&](std::size_t column) {
        return std::max(gray_[first[column]], gray_[second[column]]);
    };
    std::array<Lanes, kRowSteps> pixels;
    for (std::size_t i = 0; i < kRowSteps; ++i) {
        pixels[i] = Lanes{brighter(i), brighter(i + kRowSteps), brighter(i + 2 * kRowSteps),
                          brighter(i + 3 * kRowSteps)};
    }
    Lanes* narrow = &narrow_[row * kNarrowSteps];
    for (const auto& [at, weights] : columns_) {
        *narrow++ = weights[0] * pixels[at] + weights[1] * pixels[at + 1] + weights[2] * pixels[at + 2];
    }
}

// The vertical pass, rounded to bytes.
void FramePipeline::shorten_rows(std::size_t frame_row) {
    const AreaCell& cell = row_cells_[frame_row];
    std::uint8_t* const target = &frame_[frame_row * kFrameWidth];
    for (std::size_t i = 0; i < kNarrowSteps; ++i) {
        const Lanes* source = &narrow_[static_cast<std::size_t>(cell.first) * kNarrowSteps + i];
        Lanes sum = cell.weights[0] * source[0];
        for (std::size_t tap = 1; tap < cell.weights.size(); ++tap) {
            sum += cell.weights[tap] * source[tap * kNarrowSteps];
        }
        for (std::size_t q = 0; q < kLanes; ++q) target[q * kNarrowSteps + i] = round_to_byte(sum[q]);
    }
}

void FramePipeline::write(std::span<std::uint8_t> frame) {
    require_size(frame.size(), kFrameSize, "the memory for a frame");
    for (std::size_t row = 0; row < height_; ++row) {
        if (changed_[row]) narrow_row(row);
    }
    for (std::size_t frame_row = 0; frame_row < kFrameHeight; ++frame_row) {
        const AreaCell& cell = row_cells_[frame_row];
        const auto begin = changed_.begin() + cell.first;
        if (std::any_of(begin, begin + std::ssize(cell.weights), [](auto changed) { return changed != 0; })) {
            shorten_rows(frame_row);
        }
    }
    std::ranges::fill(changed_, std::uint8_t{false});
    std::ranges::copy(frame_, frame.begin());
}

FrameStack::FrameStack(std::size_t num_envs, std::size_t depth, std::size_t frame_size)
    : num_envs_(num_envs), depth_(depth), frame_size_(frame_size), data_(num_envs * depth * frame_size) {
    if (data_.empty())
        throw std::invalid_argument("a frame stack needs environments, a depth and a frame size");
}

std::span<std::uint8_t> FrameStack::stack_of(std::size_t env) {
    if (env >= num_envs_) {
        throw std::out_of_range("there is no environment " + std::to_string(env) + " among " +
                                std::to_string(num_envs_));
    }
    return std::span(data_).subspan(env * depth_ * frame_size_, depth_ * frame_size_);
}

void FrameStack::push(std::size_t env, std::span<const std::uint8_t> frame) {
    const auto stack = stack_of(env);
    require_size(frame.size(), frame_size_, "a frame");
    std::ranges::copy(stack.subspan(frame_size_), stack.begin());
    std::ranges::copy(frame, stack.end() - static_cast<std::ptrdiff_t>(frame_size_));
}

void FrameStack::assign(std::span<const std::uint8_t> data) {
    require_size(data.size(), data_.size(), "a frame stack");
    std::ranges::copy(data, data_.begin());
}

void FrameStack::clear(std::size_t env) {
    std::ranges::fill(stack_of(env), std::uint8_t{0});
}

void FrameStack::follow(std::size_t env, const StepResult& result, std::span<const std::uint8_t> frame) {
    if (result.terminal || result.truncated) clear(env);
    push(env, frame);
}

}  // namespace cale
