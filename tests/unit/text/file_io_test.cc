#include "text/file_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

namespace mapp {
namespace {

using testing::StartsWith;

TEST(FileIoTest, ReadsBackWhatItWrote) {
  const std::string file = testing::TempDir() + "/mapp_file_io_test";
  const std::string content("a\0b\n\xff", 5);
  std::ostringstream unused;
  ASSERT_TRUE(WriteOutput(file, content, unused).ok());
  const StatusOr<std::string> read = ReadInput(file);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(*read, content);
  std::filesystem::remove(file);
}

TEST(FileIoTest, WritesToTheStreamForADash) {
  std::ostringstream out;
  ASSERT_TRUE(WriteOutput("-", "hello", out).ok());
  EXPECT_EQ(out.str(), "hello");
}

TEST(FileIoTest, NamesTheFileThatCannotBeOpened) {
  std::ostringstream unused;
  EXPECT_THAT(std::string(WriteOutput("/no/such/folder/f", "", unused).message()), StartsWith("/no/such/folder/f: "));
  const Status read = ReadInput("/no/such/file").status();
  EXPECT_EQ(read.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(read.message()), StartsWith("/no/such/file: "));
}

TEST(FileIoTest, FullDiskIsAnErrorAndLeavesNoHalfFile) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  const std::string link = testing::TempDir() + "/mapp_full_disk";
  std::filesystem::remove(link);
  std::filesystem::create_symlink("/dev/full", link);
  std::ostringstream unused;
  EXPECT_FALSE(WriteOutput(link, std::string(1 << 20, 'x'), unused).ok());
  EXPECT_FALSE(std::filesystem::is_symlink(link));
}

}  // namespace
}  // namespace mapp
