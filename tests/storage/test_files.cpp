#include "storage/files.h"

#include <array>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "support/full_disk.h"
#include "support/temporary_folder.h"
#include "support/working_folder.h"

namespace cale {
namespace {

using test::FullDisk;
using test::TemporaryFolder;

TEST(Files, WriteAndReadAgain) {
    TemporaryFolder folder;
    std::string bytes(1'000'000, 'x');
    bytes[10] = '\0';
    write_file_atomically(folder / "a", bytes);
    EXPECT_EQ(read_file(folder / "a"), bytes);
    write_file_atomically(folder / "a", "");
    EXPECT_EQ(read_file(folder / "a"), "");
    EXPECT_EQ(folder.file_count(), 1u);
}

TEST(Files, ALinkStaysOneAndADeviceToo) {
    const test::TemporaryFolder folder;
    write_file_atomically(folder.path() / "file", "old");
    std::filesystem::create_symlink("file", folder.path() / "link");
    write_file_atomically(folder.path() / "link", "new");
    EXPECT_TRUE(std::filesystem::is_symlink(folder.path() / "link"));
    EXPECT_EQ(read_file(folder.path() / "file"), "new");
    std::filesystem::create_directory(folder.path() / "there");
    std::filesystem::create_symlink("there/absent", folder.path() / "dangling");
    write_file_atomically(folder.path() / "dangling", "made");
    EXPECT_TRUE(std::filesystem::is_symlink(folder.path() / "dangling"));
    EXPECT_EQ(read_file(folder.path() / "there/absent"), "made");
    ASSERT_EQ(::mkfifo((folder.path() / "pipe").c_str(), 0600), 0);
    EXPECT_THROW(write_file_atomically(folder.path() / "pipe", "new"), std::runtime_error);
    EXPECT_TRUE(std::filesystem::is_fifo(folder.path() / "pipe"));
}

TEST(Files, PiecesAreJoined) {
    TemporaryFolder folder;
    const std::array<std::string_view, 3> pieces{"one", "", "two"};
    write_file_atomically(folder / "a", pieces);
    EXPECT_EQ(folder.read("a"), "onetwo");
}

TEST(Files, RelativeNamesWithoutAFolder) {
    TemporaryFolder folder;
    const test::WorkingFolder here(folder.path());
    write_file_atomically("a", "contents");
    EXPECT_EQ(folder.read("a"), "contents");
}

TEST(Files, ReadersMayOpenWhatWasWritten) {
    TemporaryFolder folder;
    const auto mask = ::umask(022);
    write_file_atomically(folder / "a", "x");
    ::umask(mask);
    struct stat status {};
    ASSERT_EQ(::stat((folder / "a").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777u, 0644u);
}

TEST(Files, LeftoversOfAKilledProcessAreInNobodysWay) {
    TemporaryFolder folder;
    for (int attempt = 0; attempt < 3; ++attempt) {
        folder.write("a.tmp-" + std::to_string(::getpid()) + "-" + std::to_string(attempt), "half");
    }
    write_file_atomically(folder / "a", "whole");
    EXPECT_EQ(folder.read("a"), "whole");
    EXPECT_EQ(folder.file_count(), 4u);
}

TEST(Files, ADiskThatFillsUpLeavesTheOldFile) {
    TemporaryFolder folder;
    const auto file = folder.write("a", "old");
    std::string error;
    {
        const FullDisk full(4096);
        error = test::error_of<std::system_error>(
            [&] { write_file_atomically(file, std::string(100'000, 'x')); });
    }
    EXPECT_EQ(error, "cannot write '" + file.string() + "': File too large");
    EXPECT_EQ(folder.read("a"), "old");
    EXPECT_EQ(folder.file_count(), 1u);
}

TEST(Files, ErrorsNameFileAndReason) {
    TemporaryFolder folder;
    const auto missing = folder / "nowhere/a";
    EXPECT_EQ(test::error_of<std::system_error>([&] { write_file_atomically(missing, "x"); }),
              "cannot write '" + missing.string() + "': No such file or directory");
    EXPECT_EQ(test::error_of<std::system_error>([&] { read_file(missing); }),
              "cannot read '" + missing.string() + "': No such file or directory");
    EXPECT_EQ(test::error_of<std::system_error>([&] { read_file(folder.path()); }),
              "cannot read '" + folder.path().string() + "': Is a directory");
    folder.write("full/file", "");
    EXPECT_EQ(test::error_of<std::system_error>([&] { write_file_atomically(folder / "full", "x"); }),
              "cannot write '" + (folder / "full").string() + "': Is a directory");
    EXPECT_EQ(folder.file_count(), 1u);  // no temporary file stays
}

constexpr StreamLimits kFewBytesSoon{.bytes = 10'000, .silence = std::chrono::milliseconds(20)};

TEST(Files, ReadsWhatComesOutOfAPipe) {
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    ASSERT_EQ(::write(ends[1], "contents", 8), 8);
    ::close(ends[1]);
    EXPECT_EQ(read_file("/dev/fd/" + std::to_string(ends[0]), kFewBytesSoon), "contents");
    ::close(ends[0]);
    EXPECT_EQ(read_file("/dev/null", kFewBytesSoon), "");

    TemporaryFolder folder;
    const auto fifo = folder / "fifo";
    ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
    std::jthread writer([&] {
        const int file = ::open(fifo.c_str(), O_WRONLY);
        for (const char* part : {"a: ", "1\n"}) {
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            EXPECT_GT(::write(file, part, std::strlen(part)), 0);
        }
        ::close(file);
    });
    EXPECT_EQ(read_file(fifo), "a: 1\n");
}

TEST(Files, WaitsForNoPipeForEverAndReadsNoneWithoutEnd) {
    TemporaryFolder folder;
    const auto fifo = folder / "fifo";
    ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
    EXPECT_EQ(
        test::error_of<std::runtime_error>([&] { read_file(fifo, kFewBytesSoon); }),
        "cannot read '" + fifo.string() + "': it is no regular file, and nothing came out of it in time");
    EXPECT_EQ(test::error_of<std::runtime_error>([&] { read_file("/dev/zero", kFewBytesSoon); }),
              "cannot read '/dev/zero': it is no regular file, and more comes out of it than 10000 bytes");
}

}  // namespace
}  // namespace cale
