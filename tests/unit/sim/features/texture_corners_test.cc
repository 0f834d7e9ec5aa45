#include "sim/features/texture_corners.h"

#include "textured_world.h"

#include <gtest/gtest.h>

namespace mapp::sim {
namespace {

GrayImage Bricks() {
  Rng rng(3);
  return PaintBricks({2, 1, 200}, rng);
}

TEST(TextureCornersTest, LevelsHaveThinnedCornersInTheirCells) {
  const TextureCorners corners(Bricks());
  ASSERT_GE(corners.levels().size(), 8U);
  double pitch_texels = 1;
  for (const CornerLevel& level : corners.levels()) {
    EXPECT_NEAR(level.pitch_texels, pitch_texels, 1e-5 * pitch_texels);
    pitch_texels *= static_cast<double>(kPyramidScale);
    size_t count = 0;
    for (int row = 0; row < level.rows; ++row) {
      for (int column = 0; column < level.columns; ++column) {
        const auto cell = level.Cell(column, row);
        count += cell.size();
        EXPECT_LE(cell.size(), static_cast<size_t>(TextureCorners::kMaxPerCell));
        for (size_t i = 1; i < cell.size(); ++i) EXPECT_LE(cell[i].response, cell[i - 1].response);
        for (const TextureCorner& corner : cell) {
          EXPECT_EQ(static_cast<int>(static_cast<double>(corner.x_texels) / level.cell_texels), column);
          EXPECT_EQ(static_cast<int>(static_cast<double>(corner.y_texels) / level.cell_texels), row);
        }
      }
    }
    EXPECT_EQ(count, level.corners.size());
  }
  EXPECT_GT(corners.levels().front().corners.size(), 200U);
}

TEST(TextureCornersTest, PlainPictureHasNone) {
  const TextureCorners corners(GrayImage(200, 100, 128));
  for (const CornerLevel& level : corners.levels()) EXPECT_TRUE(level.corners.empty());
}

TEST(TextureCornersTest, TinyPictureHasNoLevels) { EXPECT_TRUE(TextureCorners(GrayImage(8, 8, 128)).levels().empty()); }

}  // namespace
}  // namespace mapp::sim
