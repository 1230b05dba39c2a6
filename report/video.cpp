#include "report/video.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "storage/descriptor.h"

namespace cale {
namespace {

std::error_code newest_error() {
    return {errno, std::generic_category()};
}

/// What begins with a word and a colon, such as 12:30/film.mp4, FFmpeg takes for an address.
std::string name_for_ffmpeg(const std::filesystem::path& path) {
    return std::filesystem::absolute(path).string();
}

/// Why the system would not write to the end of the file, for which it is made if need be; false: it would.
/// The file is as long afterwards as before; one that was made in vain is removed.
std::error_code reason_against_writing(const std::filesystem::path& path) {
    constexpr std::size_t kBlock = 65'536;  // more than a film's header
    std::error_code ignored;
    const bool is_new = !std::filesystem::exists(path, ignored);
    Descriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    if (!file.is_open()) return newest_error();
    const ::off_t size = ::lseek(file.get(), 0, SEEK_END);
    std::error_code reason;
    const std::string zeros(kBlock, '\0');
    if (!write_all(file, zeros)) reason = newest_error();
    // Some file systems find out at the end.
    if (::ftruncate(file.get(), size) != 0 && !reason) reason = newest_error();
    if (file.close() != 0 && !reason) reason = newest_error();
    if (reason && is_new) std::filesystem::remove(path, ignored);
    return reason;
}

}  // namespace

struct VideoWriter::Impl {
    std::filesystem::path path;
    int width;
    int height;
    int scale;
    cv::VideoWriter writer{};
    std::string_view codec{};
    std::int64_t frames = 0;
};

VideoWriter::VideoWriter(const std::filesystem::path& path, int width, int height, double frames_per_second,
                         int scale)
    : impl_(std::make_unique<Impl>(Impl{.path = path, .width = width, .height = height, .scale = scale})) {
    if (width < 1 || height < 1 || scale < 1 || width * scale % 2 != 0 || height * scale % 2 != 0) {
        throw std::invalid_argument(fmt::format(
            "a film of {} x {} pixels, each {} wide, cannot be encoded: its sides must be positive and even",
            width, height, scale));
    }
    if (path.extension() != ".mp4") {
        throw std::invalid_argument(
            fmt::format("cannot film to {}: its name must end in .mp4", path.string()));
    }
    std::error_code ignored;
    const bool is_new = !std::filesystem::exists(path, ignored);
    // OpenCV does not say why it cannot open a file.
    if (const auto reason = reason_against_writing(path))
        throw std::system_error(reason, fmt::format("cannot film to {}", path.string()));

    const cv::Size size(width * scale, height * scale);
    constexpr std::pair<const char*, std::string_view> codecs[] = {{"avc1", "H.264"}, {"mp4v", "MPEG-4"}};
    for (const auto& [code, name] : codecs) {
        impl_->codec = name;
        if (impl_->writer.open(name_for_ffmpeg(path), cv::CAP_FFMPEG,
                               cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]), frames_per_second,
                               size)) {
            return;
        }
    }
    if (is_new) std::filesystem::remove(path, ignored);
    throw std::runtime_error(
        fmt::format("cannot film to {}: this OpenCV encodes neither H.264 nor MPEG-4; it needs FFmpeg "
                    "(Debian's libopencv-videoio has it)",
                    path.string()));
}

VideoWriter::~VideoWriter() = default;
VideoWriter::VideoWriter(VideoWriter&&) noexcept = default;
VideoWriter& VideoWriter::operator=(VideoWriter&&) noexcept = default;

std::string_view VideoWriter::codec() const {
    return impl_->codec;
}

void VideoWriter::write(std::span<const std::uint8_t> rgb) {
    const auto expected =
        std::size_t{3} * static_cast<std::size_t>(impl_->width) * static_cast<std::size_t>(impl_->height);
    if (rgb.size() != expected) {
        throw std::invalid_argument(fmt::format("a frame for {} has {} bytes instead of {} ({} x {} x RGB)",
                                                impl_->path.string(), rgb.size(), expected, impl_->height,
                                                impl_->width));
    }
    const cv::Mat frame(impl_->height, impl_->width, CV_8UC3, const_cast<std::uint8_t*>(rgb.data()));
    cv::Mat bgr, large;
    cv::cvtColor(frame, bgr, cv::COLOR_RGB2BGR);
    cv::resize(bgr, large, {}, impl_->scale, impl_->scale, cv::INTER_NEAREST);
    impl_->writer.write(large);
    ++impl_->frames;
}

void VideoWriter::close() {
    impl_->writer.release();
    // OpenCV does not report frames that it could not write. A film that was cut short has no index,
    // so it does not even open.
    cv::VideoCapture film;
    const bool opened = film.open(name_for_ffmpeg(impl_->path), cv::CAP_FFMPEG);
    const auto frames = opened ? std::llround(film.get(cv::CAP_PROP_FRAME_COUNT)) : 0;
    if (frames != impl_->frames) {
        const auto text = fmt::format("the film {} is damaged: {} of its {} frames can be read back",
                                      impl_->path.string(), frames, impl_->frames);
        if (const auto reason = reason_against_writing(impl_->path))
            throw std::system_error(reason, text + "; its end could not be written");
        throw std::runtime_error(text + "; is the disk full?");
    }
}

}  // namespace cale
