#include "sim/features/texture_corners.h"

#include "textured_world.h"

#include <gtest/gtest.h>

#include <array>
#include <thread>
#include <vector>

namespace mapp::sim {
namespace {

TextureCorners CornersOf(GrayImage image) {
  return TextureCorners({std::make_shared<const Texture>(std::move(image))});
}

TextureCorners Bricks() {
  Rng rng(3);
  return CornersOf(PaintBricks({2, 1, 200}, rng));
}

std::vector<TextureCorner> All(const CornerLevel& level) {
  std::vector<TextureCorner> all;
  for (int row = 0; row < level.rows(); ++row) {
    for (int column = 0; column < level.columns(); ++column) {
      const auto cell = level.Cell(column, row);
      all.insert(all.end(), cell.begin(), cell.end());
    }
  }
  return all;
}

TEST(TextureCornersTest, LevelsHaveThinnedCornersInTheirCells) {
  const TextureCorners corners = Bricks();
  ASSERT_GE(corners.levels().size(), 8U);
  double pitch_texels = 1;
  for (const CornerLevel& level : corners.levels()) {
    EXPECT_NEAR(level.pitch_texels(), pitch_texels, 1e-5 * pitch_texels);
    pitch_texels *= static_cast<double>(kPyramidScale);
    for (int row = 0; row < level.rows(); ++row) {
      for (int column = 0; column < level.columns(); ++column) {
        const auto cell = level.Cell(column, row);
        EXPECT_LE(cell.size(), static_cast<size_t>(CornerLevel::kMaxPerCell));
        for (size_t i = 1; i < cell.size(); ++i) EXPECT_LE(cell[i].response, cell[i - 1].response);
        for (const TextureCorner& corner : cell) {
          EXPECT_EQ(static_cast<int>(static_cast<double>(corner.x_texels) / level.cell_texels()), column);
          EXPECT_EQ(static_cast<int>(static_cast<double>(corner.y_texels) / level.cell_texels()), row);
        }
      }
    }
  }
  EXPECT_GT(All(corners.levels().front()).size(), 200U);
}

TEST(TextureCornersTest, DoNotDependOnTheOrderOfAsking) {
  const TextureCorners corners = Bricks(), again = Bricks();
  const CornerLevel& level = corners.levels()[1];
  const CornerLevel& other = again.levels()[1];
  for (int row = other.rows() - 1; row >= 0; --row) {
    for (int column = other.columns() - 1; column >= 0; --column) other.Cell(column, row);
  }
  const std::vector<TextureCorner> a = All(level), b = All(other);
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].x_texels, b[i].x_texels);
    EXPECT_EQ(a[i].y_texels, b[i].y_texels);
    EXPECT_EQ(a[i].descriptor, b[i].descriptor);
  }
}

TEST(TextureCornersTest, ManyThreadsMayAskAtOnce) {
  const TextureCorners corners = Bricks();
  std::array<size_t, 4> counts{};
  {
    std::vector<std::jthread> threads;
    for (size_t& count : counts) {
      threads.emplace_back([&corners, &count] {
        for (const CornerLevel& level : corners.levels()) count += All(level).size();
      });
    }
  }
  for (const size_t count : counts) EXPECT_EQ(count, counts[0]);
}

TEST(TextureCornersTest, PlainPictureHasNone) {
  const TextureCorners corners = CornersOf(GrayImage(200, 100, 128));
  for (const CornerLevel& level : corners.levels()) EXPECT_TRUE(All(level).empty());
}

TEST(TextureCornersTest, TinyPictureHasNoLevels) { EXPECT_TRUE(CornersOf(GrayImage(8, 8, 128)).levels().empty()); }

}  // namespace
}  // namespace mapp::sim
