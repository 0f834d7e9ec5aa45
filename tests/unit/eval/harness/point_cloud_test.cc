#include "eval/harness/point_cloud.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gtest/gtest.h>

#include <fstream>

namespace mapp {
namespace {

constexpr const char* kHeader =
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nend_header\n";

StatusOr<std::vector<Eigen::Vector3d>> Read(const std::string& content) {
  const test::TempFolder folder;
  std::ofstream(folder.File("map.ply")) << content;
  return ReadAsciiPly(folder.File("map.ply"));
}

TEST(PointCloudTest, PositionsAreTheFirstProperties) {
  const auto points = Read(std::string(kHeader) + "1 2 3 200\n-4.5 0 1e-3 7\n");
  ASSERT_TRUE(points.ok()) << points.status();
  ASSERT_EQ(points->size(), 2U);
  EXPECT_EQ((*points)[1], Eigen::Vector3d(-4.5, 0, 1e-3));
}

TEST(PointCloudTest, BrokenFilesAreRefused) {
  EXPECT_EQ(Read(std::string(kHeader) + "1 2 3 200\n").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Read(std::string(kHeader) + "1 2 3 4\n1 x 3 4\n").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Read("ply\nformat binary_little_endian 1.0\nend_header\n").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Read("").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(ReadAsciiPly("/nowhere/map.ply").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp
