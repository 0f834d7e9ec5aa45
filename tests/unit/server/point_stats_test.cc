#include "server/service/point_stats.h"

#include <gtest/gtest.h>

namespace mapp::testing {
namespace {

Sighting Seen(uint64_t frame, const Eigen::Vector3d& center) {
  return {.frame = FrameId(frame), .camera_center = center, .octave = 2};
}

PointRecord SeenFrom(const Eigen::Vector3d& center) {
  PointRecord point;
  point.position = Eigen::Vector3d::Zero();
  InitPointStats(point, Seen(1, center), OrbDescriptor(), 3);
  return point;
}

TEST(PointStatsTest, RebuildsThePointThatWasSeen) {
  Camera camera;
  camera.projection = RadialTangentialCamera{458, 457, 367, 248, -0.28, 0.07, 0.0002, 0.00002};
  camera.width_px = 752;
  camera.height_px = 480;
  const Pose3 T_map_camera(Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized())),
                           Eigen::Vector3d(5, -2, 1));
  const Eigen::Vector3d p_camera(0.8, -0.5, 2.5);
  const Eigen::Vector2d pixel = camera.Project(p_camera);
  const Keypoint keypoint{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), 0, 0};
  EXPECT_LT((RebuildPoint(camera, T_map_camera, keypoint, p_camera.z()) - T_map_camera * p_camera).norm(), 1e-5);
}

TEST(PointStatsTest, FirstObservationSetsEverything) {
  const PointRecord point = SeenFrom({0, 0, -4});
  EXPECT_LT((point.view_direction - Eigen::Vector3f::UnitZ()).norm(), 1e-6F);
  EXPECT_FLOAT_EQ(point.reference_distance_m, 4 * OctaveScale(2));
  EXPECT_EQ(point.num_observations, 3U);
  EXPECT_EQ(point.observers, std::vector{FrameId(1)});
}

TEST(PointStatsTest, MeansMoveWithTheWeightOfOneObservation) {
  PointRecord point = SeenFrom({0, 0, -4});
  const Eigen::Vector3d centers[] = {{0, 0, -4}};
  AddObservation(point, Seen(2, {-4, 0, 0}), centers);
  EXPECT_EQ(point.num_observations, 4U);
  EXPECT_NEAR(point.view_direction.norm(), 1, 1e-6);
  EXPECT_NEAR(point.view_direction.x() / point.view_direction.z(), 1.0 / 3.0, 1e-6);
  EXPECT_FLOAT_EQ(point.reference_distance_m, 4 * OctaveScale(2));
}

TEST(PointStatsTest, AnObservationTakenBackLeavesWhatWasBefore) {
  PointRecord point = SeenFrom({0, 0.5, -4});
  const Eigen::Vector3d centers[] = {{0, 0.5, -4}, {-4, 0, -1}, {1, -2, -3}};
  AddObservation(point, Seen(2, centers[1]), std::span(centers).first(1));
  const PointRecord before = point;
  AddObservation(point, Seen(3, centers[2]), std::span(centers).first(2));
  AddObservation(point, Seen(4, {3, 0, -3}), centers);
  RemoveObservation(point, Seen(4, {3, 0, -3}));
  RemoveObservation(point, Seen(3, centers[2]));
  EXPECT_EQ(point.num_observations, before.num_observations);
  EXPECT_EQ(point.observers, before.observers);
  EXPECT_LT((point.view_direction - before.view_direction).norm(), 1e-6F);
  EXPECT_NEAR(point.reference_distance_m, before.reference_distance_m, 1e-5);
}

TEST(PointStatsTest, CamerasOfEveryFocalLengthTellTheSameReference) {
  // Twice the focal length from twice as far: as large in the image, so of the same octave.
  PointRecord point = SeenFrom({0, 0, -4});
  Sighting from_afar = Seen(2, {0, 0, -8});
  from_afar.focal_px = 2 * kReferenceFocalPx;
  const Eigen::Vector3d centers[] = {{0, 0, -4}};
  AddObservation(point, from_afar, centers);
  EXPECT_FLOAT_EQ(point.reference_distance_m, 4 * OctaveScale(2));
  EXPECT_FLOAT_EQ(ReferenceFor(from_afar.focal_px, point.reference_distance_m), 8 * OctaveScale(2));
}

TEST(PointStatsTest, OppositeViewsKeepTheOldDirection) {
  PointRecord point = SeenFrom({0, 0, -4});
  point.num_observations = 1;
  const Eigen::Vector3d centers[] = {{0, 0, -4}};
  AddObservation(point, Seen(2, {0, 0, 4}), centers);
  EXPECT_LT((point.view_direction - Eigen::Vector3f::UnitZ()).norm(), 1e-6F);
}

TEST(PointStatsTest, KeepsTheObserversThatDifferMost) {
  PointRecord point = SeenFrom({0, 0, -4});
  std::vector<Eigen::Vector3d> centers = {{0, 0, -4}};
  const auto observe = [&](uint64_t frame, const Eigen::Vector3d& center) {
    AddObservation(point, Seen(frame, center), centers);
  };
  for (const auto& [frame, center] :
       std::vector<std::pair<uint64_t, Eigen::Vector3d>>{{2, {-4, 0, 0}}, {3, {0.1, 0, -4}}, {4, {4, 0, 0}}}) {
    observe(frame, center);
    centers.push_back(center);
  }
  EXPECT_EQ(point.observers.size(), 4U);
  // From above: frame 3 sees the point almost as frame 1 does and makes room.
  observe(5, {0, -4, 0});
  EXPECT_EQ(point.observers, (std::vector{FrameId(1), FrameId(2), FrameId(4), FrameId(5)}));
  centers = {{0, 0, -4}, {-4, 0, 0}, {4, 0, 0}, {0, -4, 0}};
  // Nothing new: the newcomer is the one left out.
  observe(6, {0, 0.1, -4});
  EXPECT_EQ(point.observers, (std::vector{FrameId(1), FrameId(2), FrameId(4), FrameId(5)}));
}

}  // namespace
}  // namespace mapp::testing
