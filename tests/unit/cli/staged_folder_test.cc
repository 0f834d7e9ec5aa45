#include "cli/staged_folder.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

namespace mapp {
namespace {

namespace fs = std::filesystem;

std::ptrdiff_t CountEntries(const fs::path& folder) {
  return std::distance(fs::directory_iterator(folder), fs::directory_iterator());
}

TEST(StagedFolderTest, AppearsWholeWhenCommitted) {
  const test::TempFolder temp;
  const fs::path target = temp.path() / "a" / "b";
  auto staged = StagedFolder::Create(target.string());
  ASSERT_TRUE(staged.ok()) << staged.status();
  std::ofstream(staged->path() / "file") << "content";
  EXPECT_FALSE(fs::exists(target));
  ASSERT_TRUE(staged->Commit().ok());
  EXPECT_TRUE(fs::exists(target / "file"));
  EXPECT_EQ(CountEntries(temp.path() / "a"), 1);
}

TEST(StagedFolderTest, LeavesNothingWithoutCommit) {
  const test::TempFolder temp;
  {
    auto staged = StagedFolder::Create(temp.File("a/b/c/"));
    ASSERT_TRUE(staged.ok()) << staged.status();
    fs::create_directories(staged->path() / "deep" / "deeper");
    std::ofstream(staged->path() / "deep" / "file") << "content";
  }
  EXPECT_EQ(CountEntries(temp.path()), 0);
}

TEST(StagedFolderTest, TakesThePlaceOfAnEmptyFolderOnly) {
  const test::TempFolder temp;
  fs::create_directory(temp.path() / "empty");
  auto staged = StagedFolder::Create(temp.File("empty"));
  ASSERT_TRUE(staged.ok()) << staged.status();
  EXPECT_TRUE(staged->Commit().ok());

  const std::string file = temp.Write("full/file", "content");
  for (const std::string& taken : {temp.File("full"), file}) {
    const Status status = StagedFolder::Create(taken).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kAlreadyExists);
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr(taken));
  }
}

TEST(StagedFolderTest, ReportsAPlaceWhereNoFolderCanBe) {
  const test::TempFolder temp;
  const std::string file = temp.Write("file", "content");
  const Status status = StagedFolder::Create(file + "/below/here").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr(file));
}

TEST(StagedFolderTest, DoesNotReplaceWhatCameInTheMeantime) {
  const test::TempFolder temp;
  {
    auto staged = StagedFolder::Create(temp.File("place"));
    ASSERT_TRUE(staged.ok());
    temp.Write("place/other", "content");
    EXPECT_EQ(staged->Commit().code(), absl::StatusCode::kFailedPrecondition);
  }
  EXPECT_EQ(CountEntries(temp.path()), 1);
}

}  // namespace
}  // namespace mapp
