#include "policy/observer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace cale {
namespace {

std::array<std::uint8_t, 256> every_gray() {
    std::array<std::uint8_t, 256> gray{};
    for (std::size_t i = 0; i < gray.size(); ++i) gray[i] = static_cast<std::uint8_t>(i);
    return gray;
}

/// Returns the pipeline from screens to frames; none for memory.
std::optional<FramePipeline> pipeline_for(const PolicyInfo& info, int screen_height) {
    if (info.frame_height == 1) return std::nullopt;
    if (Observer::observes(info)) return FramePipeline(screen_height, every_gray());
    throw std::invalid_argument("this policy reads frames of " + std::to_string(info.frame_height) + "x" +
                                std::to_string(info.frame_width) +
                                "; an Observer makes frames of 84x84: make the observations yourself");
}

}  // namespace

std::uint8_t luminance(std::uint8_t red, std::uint8_t green, std::uint8_t blue) {
    return static_cast<std::uint8_t>(std::round(red * 0.2989 + green * 0.5870 + blue * 0.1140));
}

bool Observer::observes(const PolicyInfo& info) {
    return info.frame_height == 1 || (info.frame_height == kFrameHeight && info.frame_width == kFrameWidth);
}

Observer::Observer(const PolicyInfo& info, int screen_height)
    : frame_skip_(info.frame_skip),
      life_loss_ends_episode_(info.life_loss_ends_episode),
      pipeline_(pipeline_for(info, screen_height)),
      stack_(1, static_cast<std::size_t>(info.stack),
             static_cast<std::size_t>(info.frame_height * info.frame_width)),
      gray_(pipeline_ ? static_cast<std::size_t>(screen_height) * kScreenWidth : 0),
      frame_(static_cast<std::size_t>(info.frame_height * info.frame_width)) {}

void Observer::start(std::span<const std::uint8_t> screen) {
    require_size(screen);
    if (pipeline_) {
        pipeline_->start(gray(screen));
    } else {
        std::ranges::copy(screen, frame_.begin());
    }
    stack_.clear(0);
    complete_step();
}

void Observer::see(std::span<const std::uint8_t> screen) {
    require_size(screen);
    if (frames_left_ == 0) frames_left_ = frame_skip_;
    --frames_left_;
    // The last two screens of a step count; the only one of a step of one frame is the first.
    if (!pipeline_) {
        std::ranges::copy(screen, frame_.begin());
    } else if (frames_left_ == 0 && frame_skip_ > 1) {
        pipeline_->set_second(gray(screen));
    } else if (frames_left_ <= 1) {
        pipeline_->set_first(gray(screen));
    }
    if (frames_left_ == 0) complete_step();
}

void Observer::lose_life() {
    if (!life_loss_ends_episode_) return;
    stack_.clear(0);
    complete_step();
}

void Observer::require_size(std::span<const std::uint8_t> screen) const {
    if (reads_memory()) {
        if (screen.size() == frame_.size()) return;
        const std::string parts =
            frame_.size() > kRamSize ? " (the memory's, then those of write_joystick_log())" : "";
        throw std::invalid_argument("this policy reads the console's memory: give it " +
                                    std::to_string(frame_.size()) + " bytes" + parts + ", not " +
                                    std::to_string(screen.size()));
    }
    const auto pixels = gray_.size();
    if (screen.size() == pixels || screen.size() == 3 * pixels) return;
    throw std::invalid_argument("a screen has " + std::to_string(screen.size()) + " bytes: it must have " +
                                std::to_string(pixels) + " (gray) or " + std::to_string(3 * pixels) +
                                " (RGB)");
}

std::span<const std::uint8_t> Observer::gray(std::span<const std::uint8_t> screen) {
    if (screen.size() == gray_.size()) return screen;
    for (std::size_t i = 0; i < gray_.size(); ++i)
        gray_[i] = luminance(screen[3 * i], screen[3 * i + 1], screen[3 * i + 2]);
    return gray_;
}

/// The screens become a frame, or the memory is one; a decision is due.
void Observer::complete_step() {
    if (pipeline_) pipeline_->write(frame_);
    stack_.push(0, frame_);
    frames_left_ = 0;
}

}  // namespace cale
