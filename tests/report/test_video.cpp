#include "report/video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/videoio.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "cale/env.h"
#include "report/scene.h"
#include "support/full_disk.h"
#include "support/temporary_folder.h"
#include "support/working_folder.h"

namespace cale {
namespace {

using ::testing::HasSubstr;

class Video : public ::testing::Test {
  protected:
    const test::TemporaryFolder temporary_;
    const std::filesystem::path& folder_ = temporary_.path();
};

std::vector<std::uint8_t> plain_frame(int width, int height, std::uint8_t red, std::uint8_t green,
                                      std::uint8_t blue) {
    std::vector<std::uint8_t> rgb;
    for (int i = 0; i < width * height; ++i) rgb.insert(rgb.end(), {red, green, blue});
    return rgb;
}

/// A frame that does not compress, so that the film is large.
std::vector<std::uint8_t> noisy_frame(int width, int height, std::uint32_t& state) {
    std::vector<std::uint8_t> rgb(static_cast<std::size_t>(3 * width * height));
    for (auto& value : rgb) value = static_cast<std::uint8_t>((state = state * 1664525u + 1013904223u) >> 24);
    return rgb;
}

TEST_F(Video, CanBeReadBack) {
    const auto path = folder_ / "game.mp4";
    VideoWriter writer(path, 160, 210, 30);
    for (int i = 0; i < 12; ++i) writer.write(plain_frame(160, 210, 200, 40, 20));
    writer.close();

    cv::VideoCapture film(path.string());
    ASSERT_TRUE(film.isOpened());
    EXPECT_EQ(film.get(cv::CAP_PROP_FRAME_COUNT), 12);
    EXPECT_EQ(film.get(cv::CAP_PROP_FRAME_WIDTH), 480);
    EXPECT_EQ(film.get(cv::CAP_PROP_FRAME_HEIGHT), 630);
    EXPECT_NEAR(film.get(cv::CAP_PROP_FPS), 30, 1e-6);
    cv::Mat frame;
    ASSERT_TRUE(film.read(frame));
    const auto pixel = frame.at<cv::Vec3b>(315, 240);  // blue, green, red
    EXPECT_NEAR(pixel[2], 200, 12);
    EXPECT_NEAR(pixel[1], 40, 12);
    EXPECT_NEAR(pixel[0], 20, 12);
    EXPECT_THAT(std::string(writer.codec()), ::testing::AnyOf("H.264", "MPEG-4"));
}

TEST_F(Video, KeepsPixelsSquareAndSharp) {
    const auto path = folder_ / "edge.mp4";
    auto rgb = plain_frame(160, 210, 0, 0, 0);
    for (std::size_t row = 0; row < 210; ++row) {  // the right half is white
        std::fill_n(rgb.begin() + static_cast<std::ptrdiff_t>(3 * (160 * row + 80)), 3 * 80,
                    std::uint8_t{255});
    }
    VideoWriter writer(path, 160, 210, 30, 3);
    writer.write(rgb);
    writer.close();
    cv::VideoCapture film(path.string());
    cv::Mat frame;
    ASSERT_TRUE(film.read(frame));
    EXPECT_LT(frame.at<cv::Vec3b>(300, 80 * 3 - 2)[1], 40);
    EXPECT_GT(frame.at<cv::Vec3b>(300, 80 * 3 + 1)[1], 215);
}

TEST_F(Video, SaysWhyItCannotBeWritten) {
    EXPECT_THAT(
        test::error_of<std::runtime_error>([&] { VideoWriter(folder_ / "missing" / "a.mp4", 160, 210, 30); }),
        HasSubstr("missing/a.mp4: No such file or directory"));
    EXPECT_THAT(test::error_of<std::invalid_argument>([&] { VideoWriter(folder_ / "a.avi", 160, 210, 30); }),
                HasSubstr(".mp4"));
    EXPECT_THAT(
        test::error_of<std::invalid_argument>([&] { VideoWriter(folder_ / "a.mp4", 161, 210, 30, 3); }),
        HasSubstr("even"));
    VideoWriter writer(folder_ / "a.mp4", 160, 210, 30);
    EXPECT_THAT(test::error_of<std::invalid_argument>([&] { writer.write(plain_frame(84, 84, 0, 0, 0)); }),
                HasSubstr("instead of 100800"));
}

TEST_F(Video, AColonInItsNameIsNoAddress) {
    const test::WorkingFolder here(folder_);
    VideoWriter film("12:30.mp4", 16, 16, 15, 1);
    film.write(plain_frame(16, 16, 1, 2, 3));
    EXPECT_NO_THROW(film.close());
}

TEST_F(Video, SaysThatTheDiskIsFullBeforeItBegins) {
    const test::FullDisk disk(100);
    EXPECT_EQ(test::error_of<std::runtime_error>([&] { VideoWriter(folder_ / "a.mp4", 160, 210, 30); }),
              "cannot film to " + (folder_ / "a.mp4").string() + ": File too large");
}

TEST_F(Video, NoticesAFullDisk) {
    // A limit on the size of files stands in for the disk.
    const test::FullDisk disk(100 * 1024);
    std::uint32_t state = 1;
    const auto message = test::error_of<std::runtime_error>([&] {
        VideoWriter writer(folder_ / "large.mp4", 160, 210, 30);
        for (int i = 0; i < 20; ++i) writer.write(noisy_frame(160, 210, state));
        writer.close();
    });
    EXPECT_THAT(message, HasSubstr("large.mp4 is damaged"));
    EXPECT_THAT(message, HasSubstr("its 20 frames"));
    EXPECT_THAT(message, HasSubstr("its end could not be written: File too large"));
}

struct Pictures {
    std::vector<std::uint8_t> screen = plain_frame(160, 210, 10, 20, 30);
    std::vector<std::uint8_t> observation = std::vector<std::uint8_t>(kFrameSize, 99);
    Scene scene{.screen = screen, .observation = observation};
};

/// Pixels of the right panel that are about this colour.
int count_colour(const Image& image, int red, int green, int blue) {
    int count = 0;
    for (int row = 0; row < image.height; ++row) {
        for (int column = 480; column < image.width; ++column) {
            const auto* pixel = &image.rgb[static_cast<std::size_t>(3 * (row * image.width + column))];
            count +=
                std::abs(pixel[0] - red) + std::abs(pixel[1] - green) + std::abs(pixel[2] - blue) < 9 ? 1 : 0;
        }
    }
    return count;
}

TEST(SceneOfAFilm, ShowsTheGameAndWhatTheAgentSees) {
    Pictures pictures;
    const auto image = compose_frame(pictures.scene);
    EXPECT_EQ(image.height, 630);
    EXPECT_EQ(image.width % 2, 0);
    EXPECT_EQ(image.rgb.size(), static_cast<std::size_t>(3 * image.width * image.height));
    EXPECT_EQ(image.rgb[3 * 479], 10);
    EXPECT_EQ(count_colour(image, 99, 99, 99), 9 * 84 * 84);
}

TEST(SceneOfAFilm, ShowsTheFireButton) {
    Pictures pictures;
    pictures.scene.action = ContinuousAction{.radius = 0.8f, .theta = 0.5f, .fire = 0.0f};
    const auto released = count_colour(compose_frame(pictures.scene), 232, 77, 61);
    pictures.scene.action->fire = 1.0f;
    const auto pressed = count_colour(compose_frame(pictures.scene), 232, 77, 61);
    EXPECT_GT(pressed, released + 3000);
}

TEST(SceneOfAFilm, TheStickPointsWhereTheActionDoes) {
    Pictures pictures;
    const auto centre_of_stick = [&](double theta) {
        pictures.scene.action = ContinuousAction{.radius = 1, .theta = static_cast<float>(theta), .fire = 0};
        const auto image = compose_frame(pictures.scene);
        double x = 0, y = 0, count = 0;
        for (int row = 0; row < 540; ++row) {
            for (int column = 480; column < image.width; ++column) {
                const auto* pixel = &image.rgb[static_cast<std::size_t>(3 * (row * image.width + column))];
                if (pixel[0] != 255 || pixel[1] != 196 || pixel[2] != 61) continue;
                x += column;
                y += row;
                ++count;
            }
        }
        return std::pair(x / count, y / count);
    };
    const auto right = centre_of_stick(0), left = centre_of_stick(3.1415927), up = centre_of_stick(1.5707963);
    EXPECT_GT(right.first, left.first + 50);
    EXPECT_NEAR(right.second, left.second, 1);
    EXPECT_LT(up.second, right.second - 30) << "theta grows counter-clockwise";
}

TEST(SceneOfAFilm, OfADiscreteAgentFollowsTheEvent) {
    Pictures pictures;
    pictures.scene.event = Event::up_right_fire;
    const auto fired = compose_frame(pictures.scene);
    pictures.scene.event = Event::up_right;
    const auto moved = compose_frame(pictures.scene);
    EXPECT_GT(count_colour(fired, 232, 77, 61), count_colour(moved, 232, 77, 61) + 3000);
}

TEST(SceneOfAFilm, RefusesPicturesOfTheWrongSize) {
    Pictures pictures;
    pictures.scene.screen_height = 250;
    EXPECT_THROW(compose_frame(pictures.scene), std::invalid_argument);
}

TEST(SceneOfAFilm, ShowsTheMemoryWithoutTheJoystickThatIsSeenBesideIt) {
    Pictures pictures;
    std::vector<std::uint8_t> memory(kRamSize + 18, 99);
    pictures.scene.observation = std::span(memory).first(kRamSize);
    const auto alone = compose_frame(pictures.scene);
    EXPECT_GT(count_colour(alone, 99, 99, 99), 9 * 84 * 80);
    pictures.scene.observation = memory;
    EXPECT_EQ(compose_frame(pictures.scene).rgb, alone.rgb);
    pictures.scene.observation = std::span(memory).first(kRamSize - 1);
    EXPECT_THROW(compose_frame(pictures.scene), std::invalid_argument);
}

}  // namespace
}  // namespace cale
