#include "terminal/failure.h"

#include <cerrno>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>

#include <ATen/ops/empty.h>
#include <c10/util/Exception.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cale {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

template <class Action>
std::string sentence_of(const Action& action) {
    try {
        action();
    } catch (const std::exception& error) {
        return failure_sentence(error);
    }
    return "no error";
}

TEST(Failure, IsSaidAsItWasThrown) {
    EXPECT_EQ(failure_sentence(std::runtime_error("the ROM is out of memory")), "the ROM is out of memory");
}

TEST(Failure, OfLibTorchHasNoStackTrace) {
    const auto sentence = sentence_of([] { TORCH_CHECK(false, "sizes differ"); });
    EXPECT_THAT(sentence, StartsWith("sizes differ"));
    EXPECT_THAT(sentence, Not(HasSubstr("frame #")));
}

TEST(Failure, OfMemorySaysWhatToMakeSmaller) {
    const std::string way_out = "there is not enough memory; free some, or ask for less";
    EXPECT_THAT(failure_sentence(std::bad_alloc()), StartsWith(way_out));
    // More than any machine has, and less than the largest size that an allocator refuses out of hand.
    EXPECT_THAT(sentence_of([] { return at::empty({std::int64_t{1} << 55}); }), StartsWith(way_out));
}

TEST(Failure, OfAFileNamesIt) {
    EXPECT_EQ(sentence_of([] { return std::filesystem::file_size("/no/such/file"); }),
              "cannot use '/no/such/file': No such file or directory");
}

TEST(Failure, OfTheFileSystemSaysWhatToDo) {
    const auto sentence_of_reason = [](int reason) {
        return failure_sentence(std::system_error(reason, std::generic_category(), "cannot write 'a.csv'"));
    };
    for (const int reason : {ENOSPC, EDQUOT})
        EXPECT_THAT(sentence_of_reason(reason), EndsWith("; make room there, or choose another folder"));
    EXPECT_EQ(sentence_of_reason(EROFS),
              "cannot write 'a.csv': Read-only file system; choose another folder");
    EXPECT_EQ(sentence_of_reason(EACCES),
              "cannot write 'a.csv': Permission denied; change its permissions, or choose another path");
    const auto in_place = [](int reason) {
        return failure_sentence(std::system_error(reason, std::generic_category(), "cannot write 'a.csv'"),
                                /*may_move=*/false);
    };
    EXPECT_THAT(in_place(ENOSPC), EndsWith("; make room there"));
    EXPECT_THAT(in_place(EROFS), EndsWith("; make it writable"));
    EXPECT_THAT(in_place(EACCES), EndsWith("; change its permissions"));
    EXPECT_EQ(sentence_of_reason(EIO), "cannot write 'a.csv': Input/output error");
    const std::filesystem::filesystem_error full("cannot create folder", "runs/1",
                                                 std::make_error_code(std::errc::no_space_on_device));
    EXPECT_EQ(failure_sentence(full),
              "cannot use 'runs/1': No space left on device; make room there, or choose another folder");
}

TEST(Failure, IsOneLineThatATerminalDoesNotObey) {
    EXPECT_EQ(failure_sentence(std::runtime_error("a.csv: '\x1b]0;gotcha\x07' is no number")),
              "a.csv: '\\x1b]0;gotcha\\x07' is no number");
    EXPECT_EQ(failure_sentence(std::runtime_error("OpenCV: error\nin function 'open'\n")),
              "OpenCV: error in function 'open'");
}

}  // namespace
}  // namespace cale
