#include "storage/run_lock.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

TEST(RunLock, IsForOneProcess) {
    const test::TemporaryFolder folder;
    {
        const RunLock lock(folder.path());
        EXPECT_THAT([&] { RunLock second(folder.path()); },
                    ThrowsMessage<std::runtime_error>(
                        AllOf(HasSubstr(folder.path().string()), HasSubstr(std::to_string(::getpid())))));
    }
    EXPECT_NO_THROW(RunLock again(folder.path()));
    EXPECT_THAT([&] { RunLock nowhere(folder / "absent"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("No such file")));
}

}  // namespace
}  // namespace cale
