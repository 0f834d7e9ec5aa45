#include "vision/stereo_matcher.h"

#include "tests/unit/vision/synthetic.h"
#include "vision/orb_extractor.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mapp {
namespace {

constexpr double kBaseline_m = 0.11;
/// The wall z = 2 + 0.3 x in the left camera's frame.
constexpr double kWallDistance_m = 2.0;
constexpr double kWallSlope = 0.3;

Camera DistortedCamera(double fx) {
  return {.projection = RadialTangentialCamera{fx, fx, 322, 238, -0.28, 0.07, 0.0002, 0.00002},
          .width_px = 640,
          .height_px = 480};
}

/// Right camera 11 cm to the right, turned by about a degree on every axis.
Pose3 SkewedPair() { return Pose3(ExpSo3({0.015, -0.02, 0.012}), {kBaseline_m, 0.002, -0.001}); }

/// Where a ray of the left camera's frame meets the wall.
Eigen::Vector3d MeetWall(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  const double distance =
      (kWallDistance_m + kWallSlope * origin.x() - origin.z()) / (direction.z() - kWallSlope * direction.x());
  return origin + distance * direction;
}

GrayImage RenderWall(const Camera& camera, const Pose3& T_left_camera) {
  GrayImage image(camera.width_px, camera.height_px);
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const Eigen::Vector3d d_left = T_left_camera.rotation() * camera.Unproject({x, y});
      const Eigen::Vector3d p_left = MeetWall(T_left_camera.translation(), d_left);
      image.at(x, y) = static_cast<uint8_t>(std::lround(test::TextureAt(p_left.x() / 0.05, p_left.y() / 0.05)));
    }
  }
  return image;
}

TEST(StereoRectifierTest, RejectsBadPairs) {
  const Camera camera = DistortedCamera(400);
  Camera smaller = camera;
  smaller.width_px = 600;
  const Pose3 right(Eigen::Quaterniond::Identity(), {kBaseline_m, 0, 0});
  const auto code = [](const auto& result) { return result.status().code(); };
  EXPECT_EQ(code(StereoRectifier::Create(camera, smaller, right)), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(StereoRectifier::Create(camera, camera, Pose3())), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(StereoRectifier::Create(camera, camera, right.Inverse())), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(StereoRectifier::Create(Camera{}, Camera{}, right)), absl::StatusCode::kInvalidArgument);
}

TEST(StereoRectifierTest, KeepsAnAlignedPairAligned) {
  const Camera camera{.projection = PinholeCamera{400, 400, 320, 240}, .width_px = 640, .height_px = 480};
  const auto rectifier = StereoRectifier::Create(camera, camera, Pose3(Eigen::Quaterniond::Identity(), {0.2, 0, 0}));
  ASSERT_TRUE(rectifier.ok()) << rectifier.status();
  EXPECT_LT(RotationAngle((*rectifier)->T_left_rectified(), Pose3()), 1e-9);
  EXPECT_NEAR((*rectifier)->rectified().FocalLengths().x(), 400, 1.5);
  EXPECT_NEAR((*rectifier)->rectified().stereo_baseline_m, 0.2, 1e-12);
  EXPECT_EQ((*rectifier)->rectified().width_px, 640);
}

TEST(StereoRectifierTest, OutputsNothingForImagesOfAnotherSize) {
  const Camera camera = DistortedCamera(400);
  const auto rectifier = StereoRectifier::Create(camera, camera, SkewedPair());
  ASSERT_TRUE(rectifier.ok()) << rectifier.status();
  const GrayImage good(640, 480, 9);
  const GrayImage small(320, 240);
  GrayImage left, right;
  (*rectifier)->Rectify(good.View(), small.View(), &left, &right);
  EXPECT_EQ(left.width, 640);
  EXPECT_TRUE(right.empty());
}

TEST(StereoTest, MeasuresTheDepthOfAWall) {
  const Camera left_camera = DistortedCamera(400);
  const Camera right_camera = DistortedCamera(405);
  const auto rectifier = StereoRectifier::Create(left_camera, right_camera, SkewedPair());
  ASSERT_TRUE(rectifier.ok()) << rectifier.status();
  GrayImage left, right;
  (*rectifier)
      ->Rectify(RenderWall(left_camera, Pose3()).View(), RenderWall(right_camera, SkewedPair()).View(), &left, &right);
  const auto extractor = OrbExtractor::Create({});
  ASSERT_TRUE(extractor.ok()) << extractor.status();
  const auto left_features = (*extractor)->Extract(left.View());
  const auto right_features = (*extractor)->Extract(right.View());
  ASSERT_TRUE(left_features.ok() && right_features.ok());

  const Camera& rectified = (*rectifier)->rectified();
  const std::vector<float> depths_m =
      MatchStereo(rectified, *left_features, *right_features, left.View(), right.View());
  ASSERT_EQ(depths_m.size(), left_features->size());
  int num_matched = 0;
  int num_exact = 0;
  double sum_of_disparity_errors = 0;
  for (size_t i = 0; i < depths_m.size(); ++i) {
    if (depths_m[i] <= 0) continue;
    ++num_matched;
    const Keypoint& keypoint = (*left_features)[i].keypoint;
    const Eigen::Vector3d ray = rectified.Unproject({keypoint.u_px, keypoint.v_px});
    const Eigen::Vector3d p_left = MeetWall(Eigen::Vector3d::Zero(), (*rectifier)->T_left_rectified() * ray);
    const double true_depth_m = ((*rectifier)->T_left_rectified().Inverse() * p_left).z();
    const double bf_px_m = rectified.FocalLengths().x() * rectified.stereo_baseline_m;
    const double error_px = bf_px_m / depths_m[i] - bf_px_m / true_depth_m;
    if (std::abs(error_px) > 0.5) continue;
    ++num_exact;
    sum_of_disparity_errors += error_px;
  }
  EXPECT_GT(num_matched, 400);
  EXPECT_GT(num_exact, 0.97 * num_matched);
  // A bias of the disparity would scale every map.
  EXPECT_NEAR(sum_of_disparity_errors / num_exact, 0.0, 0.05);
}

TEST(StereoTest, AcceptsEmptyInputs) {
  const Camera camera{
      .projection = PinholeCamera{400, 400, 320, 240}, .width_px = 640, .height_px = 480, .stereo_baseline_m = 0.1};
  const std::vector<Feature> some(3);
  const GrayImage image(640, 480);
  EXPECT_TRUE(MatchStereo(camera, {}, some, image.View(), image.View()).empty());
  EXPECT_EQ(MatchStereo(camera, some, {}, image.View(), image.View()), std::vector<float>(3, 0.0F));
  EXPECT_EQ(MatchStereo(camera, some, some, {}, {}), std::vector<float>(3, 0.0F));
}

}  // namespace
}  // namespace mapp
