#include "mapp/map/depth_raster.h"

#include "mapp/map/keyframe.h"
#include "mapp/view/seen_geometry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace mapp {
namespace {

Camera RasterCamera() {
  return {.projection = PinholeCamera{525, 525, 319.5, 239.5}, .width_px = 640, .height_px = 480};
}

TEST(DepthRasterTest, KeepsTheNearestOfEachSquare) {
  const Camera camera = RasterCamera();
  DepthRasterizer rasterizer(camera);
  rasterizer.Add({5, 5}, 4);
  rasterizer.Add({20, 20}, 2.5F);
  rasterizer.Add({30, 5}, 7);
  rasterizer.Add({639.4, 479.4}, 1);
  rasterizer.Add({100, 100}, 0);    // nothing measured
  rasterizer.Add({100, 100}, 500);  // too far for a raster
  const DepthRaster raster = rasterizer.Finish();
  ASSERT_EQ(raster.samples.size(), 3U);
  EXPECT_EQ(raster.samples[0], (DepthRaster::Sample{0, 2.5F}));
  EXPECT_EQ(raster.samples[1], (DepthRaster::Sample{1, 7.0F}));
  EXPECT_EQ(raster.samples[2], (DepthRaster::Sample{NumRasterCells(camera) - 1, 1.0F}));
  EXPECT_TRUE(Validate(raster, camera).ok());
}

TEST(DepthRasterTest, SquaresCoverTheImage) {
  const Camera camera = RasterCamera();
  for (uint32_t cell = 0; cell < NumRasterCells(camera); ++cell) {
    const Eigen::Vector2d center = RasterCellCenter(camera, cell);
    EXPECT_TRUE(camera.Contains(center));
    EXPECT_EQ(RasterCellOf(camera, center), cell);
  }
  EXPECT_EQ(RasterCellOf(camera, {-0.5, -0.5}), 0U);
}

TEST(DepthRasterTest, BadRastersAreNamed) {
  const Camera camera = RasterCamera();
  const auto message = [&](std::vector<DepthRaster::Sample> samples) {
    const Status status = Validate(DepthRaster{std::move(samples)}, camera);
    EXPECT_TRUE(absl::IsInvalidArgument(status));
    return std::string(status.message());
  };
  EXPECT_THAT(message({{540, 1}}), ::testing::StartsWith("keyframe.raster[0].cell: "));
  EXPECT_THAT(message({{3, 1}, {3, 1}}), ::testing::StartsWith("keyframe.raster[1].cell: "));
  EXPECT_THAT(message({{3, 0}}), ::testing::StartsWith("keyframe.raster[0].depth_m: "));
  EXPECT_THAT(message({{3, NAN}}), ::testing::StartsWith("keyframe.raster[0].depth_m: "));
}

/// Squares without a feature of their own tell where surfaces are; others leave it to the feature.
TEST(DepthRasterTest, FillsInWhereNoFeatureIsSent) {
  const Camera camera = RasterCamera();
  Keyframe keyframe;
  KeyframeFeature feature;
  feature.keypoint = {5, 5, 0, 0};
  feature.point = PointReference{.id = 1, .depth_m = 2};
  keyframe.features.push_back(feature);
  keyframe.raster = DepthRaster{{{0, 1.9F}, {1, 4.0F}}};
  const std::vector<Eigen::Vector3f> points = OwnSurfacePoints(keyframe, camera);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_FLOAT_EQ(points[0].z(), 2);
  EXPECT_FLOAT_EQ(points[1].z(), 4);
}

/// A wall of points 6 m away, all over the image but for x < 0.
SeenGeometry HalfAWall() {
  std::vector<Eigen::Vector3f> points;
  for (float x = 0; x < 3; x += 0.1F) {
    for (float y = -2; y < 2; y += 0.1F) points.emplace_back(x, y, 6.0F);
  }
  return SeenGeometry(std::move(points));
}

TEST(SeenGeometryTest, TellsWhatIsThereFromWhatIsGone) {
  const SeenGeometry seen = HalfAWall();
  EXPECT_EQ(seen.At({1, 0, 6}), SurfaceSighting::kSeen);
  EXPECT_EQ(seen.At({1, 0, 6.3F}), SurfaceSighting::kSeen);
  EXPECT_EQ(seen.At({0.5F, 0, 3}), SurfaceSighting::kMissed);   // the ray goes on to the wall
  EXPECT_EQ(seen.At({1.5F, 0, 9}), SurfaceSighting::kUnknown);  // the wall hides it
  EXPECT_EQ(seen.At({-1, 0, 3}), SurfaceSighting::kEmpty);
  EXPECT_EQ(seen.At({1, 0, -1}), SurfaceSighting::kUnknown);
  EXPECT_EQ(SeenGeometry({}).At({0, 0, 3}), SurfaceSighting::kEmpty);
  EXPECT_FLOAT_EQ(seen.farthest_depth_m(), 6);
}

}  // namespace
}  // namespace mapp
