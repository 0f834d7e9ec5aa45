#include "mapp/view/sampler.h"

#include "mapp/base/rng.h"
#include "mapp/codec/query_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

Camera Vga() {
  return {.projection = PinholeCamera{.fx = 525, .fy = 525, .cx = 320, .cy = 240},
          .width_px = 640,
          .height_px = 480,
          .stereo_baseline_m = 0};
}

/// Points on a wall at `depth_m` that fills the image.
std::vector<Eigen::Vector3d> WallPoints(Rng& rng, double depth_m, int count) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    points.push_back(depth_m * Vga().Unproject({rng.Uniform(0, 639), rng.Uniform(0, 479)}));
  }
  return points;
}

TEST(DepthSketchTest, CodesAreWithinTheirStep) {
  for (double depth = 0.1; depth <= 100; depth *= 1.07) {
    const double back = DepthSketch::DecodeDepth(DepthSketch::EncodeDepth(depth));
    EXPECT_NEAR(back / depth, 1.0, 0.014) << depth;
  }
  EXPECT_EQ(DepthSketch::EncodeDepth(0.001), 1);
  EXPECT_EQ(DepthSketch::EncodeDepth(1e4), 255);
}

TEST(DepthSketchTest, CellsHoldPercentilesOfTheirOwnPoints) {
  const Camera camera = Vga();
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 100; ++i) points.push_back((1.0 + 0.01 * i) * camera.Unproject({10, 10}));
  const DepthSketch sketch = MakeDepthSketch(camera, points);
  EXPECT_NEAR(DepthSketch::DecodeDepth(sketch.cells[0].near_code), 1.10, 0.03);
  EXPECT_NEAR(DepthSketch::DecodeDepth(sketch.cells[0].far_code), 1.89, 0.04);
  for (int i = 1; i < DepthSketch::kCells; ++i) EXPECT_EQ(sketch.cells[static_cast<size_t>(i)].near_code, 0);
  EXPECT_TRUE(MakeDepthSketch(camera, {}).empty());
}

TEST(UniformSamplerTest, FillsTheConeEvenly) {
  const SampleSet set = SampleUniform(1.1, 20.0, 1000);
  ASSERT_EQ(set.p_camera.size(), 1000U);
  int inner = 0;
  for (const Eigen::Vector3f& p : set.p_camera) {
    EXPECT_LE(p.norm(), 20.001F);
    EXPECT_GE(p.z(), p.norm() * std::cos(0.55F) - 1e-3F);
    inner += p.norm() < 20.0F * std::cbrt(0.5F) ? 1 : 0;
  }
  EXPECT_NEAR(inner, 500, 20);
  EXPECT_NEAR(set.radius, std::cbrt(2.0 / 3.0 * M_PI * 8000 * (1 - std::cos(0.55)) / 1000), 1e-3);
}

TEST(DepthSketchSamplerTest, SamplesLieWhereTheSketchSays) {
  Rng rng(1);
  const Camera camera = Vga();
  const DepthSketch sketch = MakeDepthSketch(camera, WallPoints(rng, 3.0, 800));
  const SampleSet set = SampleDepthSketch(camera, sketch, 1000);
  ASSERT_EQ(set.p_camera.size(), 1000U);
  for (const Eigen::Vector3f& p : set.p_camera) {
    EXPECT_NEAR(p.z(), 3.0, 3.0 * (kLnDepthPadding + 0.03));
    EXPECT_TRUE(camera.Contains(camera.Project(p.cast<double>()), -0.01));
  }
  EXPECT_GE(set.radius, 0.06F);
}

TEST(DepthSketchSamplerTest, BothSidesOfTheWireGetTheSameSamples) {
  Rng rng(2);
  const Camera camera = Vga();
  ViewQuery query;
  query.sketch = MakeDepthSketch(camera, WallPoints(rng, 2.0, 300));
  const SampleSet device = SampleDepthSketch(camera, query.sketch, 777);
  const SampleSet server = SampleDepthSketch(camera, DecodeViewQuery(EncodeViewQuery(query))->sketch, 777);
  ASSERT_EQ(device.p_camera.size(), 777U);
  EXPECT_EQ(device.p_camera, server.p_camera);
  EXPECT_EQ(device.radius, server.radius);
}

TEST(DepthSketchSamplerTest, AnEmptySketchHasNoSamples) {
  EXPECT_TRUE(SampleDepthSketch(Vga(), DepthSketch{}, 1000).p_camera.empty());
}

TEST(CountBySamplesTest, VotesFollowTheSamplesAroundThem) {
  Rng rng(3);
  const Camera camera = Vga();
  const std::vector<Eigen::Vector3d> own = WallPoints(rng, 3.0, 600);
  const SampleSet set = SampleDepthSketch(camera, MakeDepthSketch(camera, own), 1000);
  // The map holds the left half of the wall.
  std::vector<bool> redundant;
  for (const Eigen::Vector3f& p : set.p_camera) redundant.push_back(p.x() < 0);
  const OverlapCount count = CountBySamples(set, redundant, own);
  int wrong = 0;
  for (size_t i = 0; i < own.size(); ++i) wrong += count.redundant[i] != (own[i].x() < 0) ? 1 : 0;
  EXPECT_LT(wrong, 40);
  EXPECT_NEAR(count.overlap, 0.5, 0.05);
  EXPECT_EQ(CountBySamples(set, std::vector<bool>(1000, true), own).overlap, 1.0);
  EXPECT_EQ(CountBySamples(set, std::vector<bool>(1000, false), own).overlap, 0.0);
}

TEST(CountBySamplesTest, UniformDropsWithinTheRadius) {
  const SampleSet set = SampleUniform(1.0, 10.0, 500);
  std::vector<bool> redundant(500, false);
  redundant[42] = true;
  const Eigen::Vector3d at = set.p_camera[42].cast<double>();
  const std::vector<Eigen::Vector3d> own = {at, at + Eigen::Vector3d(0.9 * set.radius, 0, 0),
                                            at + Eigen::Vector3d(1.1 * set.radius, 0, 0)};
  EXPECT_EQ(CountBySamples(set, redundant, own).redundant, (std::vector<bool>{true, true, false}));
}

TEST(CountBySamplesTest, AnswersOfAnotherSizeAreNotCounted) {
  const SampleSet set = SampleUniform(1.0, 10.0, 10);
  EXPECT_EQ(CountBySamples(set, std::vector<bool>(9, true), std::vector<Eigen::Vector3d>{{0, 0, 1}}).overlap, 0.0);
}

}  // namespace
}  // namespace mapp
