#include "eval/metrics/reconstruction_metrics.h"

#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mapp {
namespace {

/// The floor z = 0 and the wall x = 0.
double DistanceToCorner(const Eigen::Vector3d& p) { return std::min(std::abs(p.z()), std::abs(p.x())); }

Sim3 T_truth_map() { return {1.0, Pose3(ExpSo3({0.4, -0.2, 1.1}), {5, -3, 1})}; }

/// Points on floor and wall, in the map's frame, pushed off their surface by `offset(i)` metres.
template <typename Offset>
std::vector<Eigen::Vector3d> CornerPoints(size_t count, const Offset& offset) {
  Rng rng(3);
  std::vector<Eigen::Vector3d> p_map;
  const Pose3 T_map_truth = T_truth_map().pose.Inverse();
  for (size_t i = 0; i < count; ++i) {
    const double a = rng.Uniform(2, 9);
    const double b = rng.Uniform(-4, 4);
    p_map.push_back(T_map_truth * (i % 2 == 0 ? Eigen::Vector3d(a, b, offset(i)) : Eigen::Vector3d(offset(i), b, a)));
  }
  return p_map;
}

TEST(ReconstructionTest, PointsOnTheSurfacesHaveNoError) {
  const auto error =
      MeasureReconstruction(CornerPoints(100, [](size_t) { return 0.0; }), T_truth_map(), DistanceToCorner);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->distance_m.count, 100);
  EXPECT_NEAR(error->distance_m.max, 0, 1e-12);
  EXPECT_DOUBLE_EQ(error->within_5cm, 1);
}

TEST(ReconstructionTest, MeasuresHowFarPointsArePushedOff) {
  const double offsets_m[] = {0.02, -0.04, 0.07, -0.15, 0.3};
  const auto points = CornerPoints(500, [&](size_t i) { return offsets_m[i % 5]; });
  const auto error = MeasureReconstruction(points, T_truth_map(), DistanceToCorner);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->distance_m.median, 0.07, 1e-9);
  EXPECT_NEAR(error->distance_m.rms, std::sqrt((0.0004 + 0.0016 + 0.0049 + 0.0225 + 0.09) / 5), 1e-9);
  EXPECT_DOUBLE_EQ(error->within_5cm, 0.4);
  EXPECT_DOUBLE_EQ(error->within_10cm, 0.6);
  EXPECT_DOUBLE_EQ(error->within_20cm, 0.8);
}

TEST(ReconstructionTest, AWrongAlignmentShows) {
  const auto points = CornerPoints(400, [](size_t) { return 0.0; });
  Sim3 shifted = T_truth_map();
  shifted.pose = Pose3(Eigen::Quaterniond::Identity(), {0, 0, 0.1}) * shifted.pose;  // the floor's half is off by this
  const auto error = MeasureReconstruction(points, shifted, DistanceToCorner);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->distance_m.rms, 0.1 * std::sqrt(0.5), 1e-9);
  EXPECT_DOUBLE_EQ(error->within_5cm, 0.5);
}

TEST(ReconstructionTest, RefusesWhatHasNoError) {
  using testing::HasSubstr;
  const std::vector<Eigen::Vector3d> none;
  EXPECT_EQ(MeasureReconstruction(none, Sim3(), DistanceToCorner).status().code(), absl::StatusCode::kInvalidArgument);
  std::vector<Eigen::Vector3d> broken(3, Eigen::Vector3d::Zero());
  broken[1].y() = std::numeric_limits<double>::quiet_NaN();
  const Status not_finite = MeasureReconstruction(broken, Sim3(), DistanceToCorner).status();
  EXPECT_THAT(std::string(not_finite.message()), HasSubstr("point 1"));
  const auto nothing_near = [](const Eigen::Vector3d&) { return std::numeric_limits<double>::infinity(); };
  EXPECT_FALSE(MeasureReconstruction(std::vector<Eigen::Vector3d>(1), Sim3(), nothing_near).ok());
}

}  // namespace
}  // namespace mapp
