#include "client_sdk/src/tracker/session_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

namespace mapp::tracker {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

std::shared_ptr<const Frame> MakeFrame(size_t num_features) {
  auto frame = std::make_shared<Frame>();
  frame->features.resize(num_features);
  frame->pixels.resize(num_features, Eigen::Vector2d::Zero());
  frame->depths_m.resize(num_features, 1.0F);
  for (size_t i = 0; i < num_features; ++i) frame->features[i].descriptor.words = {i, i, i, i};
  return frame;
}

int AddEmptyKeyframe(SessionMap& map, size_t num_features, const Pose3& T_session_camera = Pose3(),
                     int generation = 0) {
  return map.AddKeyframe(MakeFrame(num_features), T_session_camera, std::vector<int>(num_features, kNone), generation);
}

TEST(SessionMapTest, KeyframeObservesThePointsItComesWith) {
  SessionMap map;
  const int first = AddEmptyKeyframe(map, 3);
  const int point = map.AddPoint({0, 0, 2}, first, 1);
  const int second = map.AddKeyframe(MakeFrame(2), Pose3(), {kNone, point}, 0);
  EXPECT_EQ(map.keyframe(second).points[1], point);
  EXPECT_EQ(map.point(point).observations.size(), 2U);
  EXPECT_THAT(map.CovisibleKeyframes(first, 1), ElementsAre(Pair(second, 1)));
  EXPECT_TRUE(map.CovisibleKeyframes(first, 2).empty());
}

TEST(SessionMapTest, RefusesASecondObservationOfOnePointOrFeature) {
  SessionMap map;
  const int keyframe = AddEmptyKeyframe(map, 3);
  const int point = map.AddPoint({0, 0, 2}, keyframe, 0);
  const int other = map.AddPoint({0, 0, 3}, keyframe, 1);
  EXPECT_FALSE(map.AddObservation(point, keyframe, 2));
  EXPECT_FALSE(map.AddObservation(other, keyframe, 0));
}

TEST(SessionMapTest, AFusedPointIsFollowedToItsSuccessor) {
  SessionMap map;
  const int first = AddEmptyKeyframe(map, 2), second = AddEmptyKeyframe(map, 2);
  const int keep = map.AddPoint({0, 0, 2}, first, 0);
  const int drop = map.AddPoint({0, 0, 2.01}, second, 1);
  map.ReplacePoint(drop, keep);
  EXPECT_EQ(map.Resolve(drop), keep);
  EXPECT_EQ(map.keyframe(second).points[1], keep);
  EXPECT_EQ(map.point(keep).observations.size(), 2U);
  map.RemovePoint(keep);
  EXPECT_EQ(map.Resolve(drop), kNone);
  EXPECT_EQ(map.keyframe(second).points[1], kNone);
}

TEST(SessionMapTest, APointWithoutObservationsIsGoneUnlessTheServerKnowsIt) {
  SessionMap map;
  const int keyframe = AddEmptyKeyframe(map, 2);
  const int own = map.AddPoint({0, 0, 2}, keyframe, 0);
  const int shared = map.AddSharedPoint({}, MapPointId(7), 0);
  ASSERT_TRUE(map.AddObservation(shared, keyframe, 1));
  map.RemoveObservation(own, keyframe);
  map.RemoveObservation(shared, keyframe);
  EXPECT_EQ(map.Resolve(own), kNone);
  EXPECT_EQ(map.Resolve(shared), shared);
}

TEST(SessionMapTest, ViewFollowsTheObservers) {
  SessionMap map;
  const int first = AddEmptyKeyframe(map, 1, Pose3(Eigen::Quaterniond::Identity(), {-1, 0, 0}));
  const int point = map.AddPoint({0, 0, 2}, first, 0);
  EXPECT_GT(map.point(point).view.view_direction.x(), 0.4F);
  const int second = AddEmptyKeyframe(map, 1, Pose3(Eigen::Quaterniond::Identity(), {1, 0, 0}));
  map.AddObservation(point, second, 0);
  map.UpdateView(point);
  EXPECT_NEAR(map.point(point).view.view_direction.x(), 0, 1e-6);
  EXPECT_NEAR(map.point(point).view.reference_distance_m, std::sqrt(5.0), 1e-5);
}

TEST(SessionMapTest, RetiringAGenerationLeavesItsPosesAndTheOthersWhole) {
  SessionMap map;
  const Pose3 T_session_camera(Eigen::Quaterniond::Identity(), {1, 2, 3});
  const int old_keyframe = AddEmptyKeyframe(map, 2, T_session_camera, 0);
  const int old_point = map.AddPoint({0, 0, 2}, old_keyframe, 0);
  const int new_keyframe = AddEmptyKeyframe(map, 2, T_session_camera, 1);
  const int new_point = map.AddPoint({0, 0, 2}, new_keyframe, 0);
  const size_t num_slots = map.num_point_slots();
  const uint64_t new_name = map.point(new_point).session_id;

  map.RetireGeneration(0);
  EXPECT_EQ(map.Resolve(old_point), kNone);
  EXPECT_EQ(map.keyframe(old_keyframe).frame, nullptr);
  EXPECT_EQ(Distance(map.keyframe(old_keyframe).T_session_camera, T_session_camera), 0);
  EXPECT_EQ(map.Resolve(new_point), new_point);
  EXPECT_THAT(map.KeyframesNear(T_session_camera, 1, 1, 1), ElementsAre(new_keyframe));
  EXPECT_TRUE(map.KeyframesNear(T_session_camera, 1, 1, 0).empty());

  // Memory is used again, names are not.
  const int next = map.AddPoint({0, 0, 4}, new_keyframe, 1);
  EXPECT_EQ(map.num_point_slots(), num_slots);
  EXPECT_GT(map.point(next).session_id, new_name);
}

TEST(SessionMapTest, ReservedNamesAreNotUsedAgain) {
  SessionMap map;
  const int keyframe = AddEmptyKeyframe(map, 1);
  const uint64_t first = map.ReserveSessionIds(5);
  EXPECT_GE(map.point(map.AddPoint({0, 0, 1}, keyframe, 0)).session_id, first + 5);
}

}  // namespace
}  // namespace mapp::tracker
