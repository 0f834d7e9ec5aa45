#include "datasets/image_file.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>

namespace mapp {
namespace {

using testing::HasSubstr;

GrayImage Gradient(int width, int height) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.at(x, y) = static_cast<uint8_t>((3 * x + 2 * y) % 256);
  }
  return image;
}

std::string Contents(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

void ExpectDataLoss(const Status& status, const std::string& file) {
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(file));
}

TEST(ImageFileTest, PngKeepsEveryPixel) {
  const test::TempFolder folder;
  const GrayImage image = Gradient(67, 41);
  ASSERT_TRUE(WriteGrayImage(folder.File("a.png"), image).ok());
  const auto read = ReadGrayImage(folder.File("a.png"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->width, 67);
  EXPECT_EQ(read->height, 41);
  EXPECT_EQ(read->pixels, image.pixels);
}

TEST(ImageFileTest, DepthIsMetresAndZeroStaysZero) {
  const test::TempFolder folder;
  DepthImage depth_m(3, 2);
  depth_m.at(0, 0) = 1.234F;
  depth_m.at(2, 1) = 7.5F;
  depth_m.at(1, 1) = 40.0F;  // 200000 units do not fit in 16 bits
  ASSERT_TRUE(WriteDepthImage(folder.File("d.png"), depth_m, 5000).ok());
  const auto read = ReadDepthImage(folder.File("d.png"), 5000);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_NEAR(read->at(0, 0), 1.234, 1e-4);
  EXPECT_NEAR(read->at(2, 1), 7.5, 1e-4);
  EXPECT_EQ(read->at(1, 1), 0);
  EXPECT_EQ(read->at(1, 0), 0);
}

class TruncatedImageTest : public testing::TestWithParam<std::string> {};

TEST_P(TruncatedImageTest, EveryTruncationIsNoticed) {
  const test::TempFolder folder;
  const std::string whole = folder.File("whole." + GetParam());
  ASSERT_TRUE(WriteGrayImage(whole, Gradient(64, 48)).ok());
  ASSERT_TRUE(ReadGrayImage(whole).ok());
  const std::string bytes = Contents(whole);
  for (size_t size = 0; size < bytes.size(); size += 1 + size / 8) {
    const std::string file = folder.Write("cut." + GetParam(), bytes.substr(0, size));
    ExpectDataLoss(ReadGrayImage(file).status(), file);
  }
  const std::string file = folder.Write("cut." + GetParam(), bytes.substr(0, bytes.size() - 1));
  ExpectDataLoss(ReadGrayImage(file).status(), file);
}

INSTANTIATE_TEST_SUITE_P(Formats, TruncatedImageTest, testing::Values("png", "jpg"));

TEST(ImageFileTest, PaddingAfterAJpegIsAccepted) {
  const test::TempFolder folder;
  ASSERT_TRUE(WriteGrayImage(folder.File("a.jpg"), Gradient(64, 48)).ok());
  const std::string file = folder.Write("b.jpg", Contents(folder.File("a.jpg")) + std::string(100, '\0'));
  EXPECT_TRUE(ReadGrayImage(file).ok());
}

TEST(ImageFileTest, DamagedPngIsNoticed) {
  const test::TempFolder folder;
  ASSERT_TRUE(WriteGrayImage(folder.File("a.png"), Gradient(64, 48)).ok());
  std::string bytes = Contents(folder.File("a.png"));
  bytes[20] = static_cast<char>(bytes[20] ^ 0x40);  // in the header chunk: the height
  const std::string file = folder.Write("b.png", bytes);
  ExpectDataLoss(ReadGrayImage(file).status(), file);
}

TEST(ImageFileTest, OtherFilesAreNoImages) {
  const test::TempFolder folder;
  const std::string file = folder.Write("a.jpg", "<html>not found</html>");
  ExpectDataLoss(ReadGrayImage(file).status(), file);
}

TEST(ImageFileTest, GrayPngIsNoDepthImage) {
  const test::TempFolder folder;
  const std::string file = folder.File("a.png");
  ASSERT_TRUE(WriteGrayImage(file, Gradient(8, 8)).ok());
  ExpectDataLoss(ReadDepthImage(file, 1000).status(), file);
}

TEST(ImageFileTest, ReportsAMissingFile) {
  const Status status = ReadGrayImage("/nowhere/a.png").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/nowhere/a.png"));
}

TEST(ImageFileTest, ReportsAFileThatCannotBeWritten) {
  const Status status = WriteGrayImage("/nowhere/a.png", Gradient(8, 8));
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/nowhere/a.png"));
}

}  // namespace
}  // namespace mapp
