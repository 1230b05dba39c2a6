// Dopamine's preprocessing, line by line: two gray buffers, pooled in place, shrunk by OpenCV.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "cale/frames.h"

class ReferenceFrames {
  public:
    ReferenceFrames(int height, const std::array<std::uint8_t, 256>& gray)
        : gray_(gray), first_(height, cale::kScreenWidth, CV_8U, cv::Scalar(0)), second_(first_.clone()) {}

    void start(std::span<const std::uint8_t> screen) {
        set_first(screen);
        second_ = 0;
    }
    void set_first(std::span<const std::uint8_t> screen) { grayscale(screen, first_); }
    void set_second(std::span<const std::uint8_t> screen) { grayscale(screen, second_); }

    std::vector<std::uint8_t> observe() {
        cv::max(first_, second_, first_);
        cv::Mat frame;
        cv::resize(first_, frame, {cale::kFrameWidth, cale::kFrameHeight}, 0, 0, cv::INTER_AREA);
        return {frame.begin<std::uint8_t>(), frame.end<std::uint8_t>()};
    }

  private:
    void grayscale(std::span<const std::uint8_t> screen, cv::Mat& buffer) {
        for (std::size_t i = 0; i < screen.size(); ++i) buffer.data[i] = gray_[screen[i]];
    }

    std::array<std::uint8_t, 256> gray_;
    cv::Mat first_;
    cv::Mat second_;
};
