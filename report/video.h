// Films of games.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string_view>

namespace cale {

/// Writes an MP4 file: H.264 where OpenCV was built with an encoder for it, which browsers
/// play, else MPEG-4, which they do not.
class VideoWriter {
  public:
    /// `width` and `height` of the frames that will be given, each of whose pixels becomes
    /// `scale` x `scale`; the film's sides must be even. Throws std::invalid_argument for an
    /// impossible size or a name that does not end in .mp4, std::system_error, with the file and the reason,
    /// if it cannot be written, and std::runtime_error where OpenCV has no encoder.
    VideoWriter(const std::filesystem::path& path, int width, int height, double frames_per_second,
                int scale = 3);
    /// Closes the file without checking that it is complete.
    ~VideoWriter();
    VideoWriter(VideoWriter&&) noexcept;
    VideoWriter& operator=(VideoWriter&&) noexcept;

    /// height x width x RGB. Throws std::invalid_argument for another size.
    void write(std::span<const std::uint8_t> rgb);
    /// Finishes the film and reads it back. Throws std::runtime_error if frames are missing, as they
    /// are when the disk is full: std::system_error where the system says why.
    void close();
    /// "H.264" or "MPEG-4".
    std::string_view codec() const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
