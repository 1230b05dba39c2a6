#include "storage/new_folder.h"

#include <filesystem>

#include <gtest/gtest.h>

#include "support/temporary_folder.h"

namespace cale {
namespace {

using test::TemporaryFolder;

TEST(NewFolder, LeavesNothingThatIsEmptyAndNew) {
    const TemporaryFolder here;
    std::filesystem::create_directory(here / "old");
    for (const auto* path : {"a/b/c", "a/b/", "a/../b/c", "old/a/../../b", "old"}) {
        {
            const NewFolder folder(here / path);
            EXPECT_TRUE(std::filesystem::is_directory(folder.path())) << path;
        }
        EXPECT_FALSE(std::filesystem::exists(here / "a")) << path;
        EXPECT_FALSE(std::filesystem::exists(here / "b")) << path;
        EXPECT_TRUE(std::filesystem::is_empty(here / "old")) << path;
    }
}

TEST(NewFolder, StaysWithWhatIsInIt) {
    const TemporaryFolder here;
    {
        const NewFolder folder(here / "a/b");
        here.write("a/file", "");
        const auto second = NewFolder::with_a_free_name(here / "a/b");
        EXPECT_EQ(second.path(), here / "a/b_2");
    }
    EXPECT_TRUE(std::filesystem::exists(here / "a/file"));
    EXPECT_FALSE(std::filesystem::exists(here / "a/b"));
    EXPECT_FALSE(std::filesystem::exists(here / "a/b_2"));
}

}  // namespace
}  // namespace cale
