#include "sim_device/feature_tracker.h"

#include "tests/unit/sim/features/textured_world.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

namespace mapp::sim {
namespace {

constexpr int64_t kFrame_ns = 66'000'000;

std::unique_ptr<FeatureTracker> MakeTracker(const std::shared_ptr<const FeatureWorld>& world,
                                            const FeatureTrackerOptions& options = {}) {
  StatusOr<std::unique_ptr<FeatureTracker>> tracker = FeatureTracker::Create(world, TestRig(), options);
  EXPECT_TRUE(tracker.ok()) << tracker.status();
  return *std::move(tracker);
}

/// Walks along the wall, 3 m from it; at most `num_frames` frames of 5 cm.
std::vector<TrackingResult> WalkAlong(FeatureTracker& tracker, int num_frames, int first = 0) {
  std::vector<TrackingResult> results;
  for (int i = first; i < first + num_frames; ++i) {
    results.push_back(tracker.Track(Look(-2 + 0.05 * i, 0), (i + 1) * kFrame_ns));
  }
  return results;
}

/// What a server would share of keyframes that it has taken over as they are.
std::shared_ptr<const SharedMap> SharedMapOf(const std::vector<Keyframe>& keyframes, const Camera& camera) {
  auto map = std::make_shared<SharedMap>();
  map->number = 1;
  std::set<uint64_t> known;
  for (const Keyframe& keyframe : keyframes) {
    for (const KeyframeFeature& feature : keyframe.features) {
      if (!feature.point || !known.insert(feature.point->id).second) continue;
      SharedPoint& point = map->points.emplace_back();
      const Eigen::Vector3d p_camera = static_cast<double>(feature.point->depth_m) *
                                       camera.Unproject({feature.keypoint.u_px, feature.keypoint.v_px});
      point.id = MapPointId(feature.point->id + 1);
      point.p_session = keyframe.T_frame_camera * p_camera;
      point.view_direction_session =
          (point.p_session - keyframe.T_frame_camera.translation()).normalized().cast<float>();
      point.descriptor = feature.descriptor;
      point.reference_distance_m = static_cast<float>(p_camera.norm()) * OctaveScale(feature.keypoint.octave);
    }
  }
  return map;
}

TEST(FeatureTrackerTest, MakesWholeKeyframesWhosePointsKeepTheirNames) {
  const auto tracker = MakeTracker(MakeFeatureWorld(WallWorld()));
  const std::vector<TrackingResult> results = WalkAlong(*tracker, 60);
  EXPECT_TRUE(results.front().is_keyframe);
  const std::vector<Keyframe> keyframes = tracker->TakeKeyframes();
  ASSERT_GE(keyframes.size(), 6U) << "at least every 15 frames, more often at the start";
  EXPECT_LE(keyframes.size(), 30U);
  std::map<uint64_t, int> last_count;
  size_t num_again = 0;
  for (size_t k = 0; k < keyframes.size(); ++k) {
    EXPECT_EQ(keyframes[k].number, k);
    EXPECT_TRUE(Validate(keyframes[k], tracker->camera(), {}).ok());
    size_t num_points = 0;
    for (const KeyframeFeature& feature : keyframes[k].features) {
      if (!feature.point) continue;
      ++num_points;
      int& count = last_count[feature.point->id];
      EXPECT_EQ(feature.point->num_observations, count + 1) << "one more for each keyframe that sees it";
      num_again += count > 0 ? 1 : 0;
      count = feature.point->num_observations;
    }
    EXPECT_GE(num_points, 700U);
  }
  EXPECT_GE(num_again, 300 * (keyframes.size() - 1));
  EXPECT_EQ(tracker->Trajectory().size(), 60U);
}

TEST(FeatureTrackerTest, TheSameSeedGivesTheSameKeyframes) {
  const auto world = MakeFeatureWorld(WallWorld());
  const auto first = MakeTracker(world), again = MakeTracker(world);
  WalkAlong(*first, 30);
  WalkAlong(*again, 30);
  const std::vector<Keyframe> a = first->TakeKeyframes(), b = again->TakeKeyframes();
  ASSERT_EQ(a.size(), b.size());
  for (size_t k = 0; k < a.size(); ++k) {
    EXPECT_EQ(Distance(a[k].T_frame_camera, b[k].T_frame_camera), 0);
    ASSERT_EQ(a[k].features.size(), b[k].features.size());
    for (size_t i = 0; i < a[k].features.size(); ++i) {
      EXPECT_EQ(a[k].features[i].descriptor, b[k].features[i].descriptor);
    }
  }
}

TEST(FeatureTrackerTest, LocalizesOnASharedMapAndFailsWhereThatEnds) {
  const auto world = MakeFeatureWorld(WallWorld());
  const auto tracker = MakeTracker(world);
  WalkAlong(*tracker, 20);
  const auto shared_map = SharedMapOf(tracker->TakeKeyframes(), tracker->camera());
  tracker->TakeSharedMap(shared_map);
  int num_localized = 0, num_would_be = 0;
  for (const TrackingResult& result : WalkAlong(*tracker, 12, 20)) {
    EXPECT_FALSE(result.is_keyframe && num_localized > 0);
    if (result.shared_map_number == 0) continue;
    EXPECT_TRUE(result.on_shared_map);
    EXPECT_GE(result.num_shared_matches, 75);
    ++num_localized;
    num_would_be += result.would_be_keyframe ? 1 : 0;
  }
  EXPECT_GE(num_localized, 3);
  EXPECT_LT(num_localized, 12) << "not every frame is looked at";
  EXPECT_GE(num_would_be, 1);
  EXPECT_TRUE(tracker->MakeKeyframeOfLastFrame().has_value());
  // The wall's other end was never mapped: the next frame that is looked at fails.
  bool has_failed = false;
  for (int i = 0; i < 3; ++i) {
    const TrackingResult result = tracker->Track(Look(4, 0), (40 + i) * kFrame_ns);
    if (result.shared_map_number == 0) continue;
    has_failed = true;
    EXPECT_FALSE(result.on_shared_map);
    EXPECT_LT(result.num_shared_matches, 75);
  }
  EXPECT_TRUE(has_failed);
  tracker->LeaveSharedMap();
  EXPECT_TRUE(tracker->Track(Look(4, 0), 43 * kFrame_ns).is_keyframe) << "mapping goes on";
}

TEST(FeatureTrackerTest, RefusesSingleCameras) {
  CameraRig rig = TestRig();
  rig.sensor = SensorKind::kMono;
  EXPECT_EQ(FeatureTracker::Create(MakeFeatureWorld(WallWorld()), rig, {}).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(FeatureTrackerTest, StereoRefersToTheRectifiedCamera) {
  const auto tracker = FeatureTracker::Create(MakeFeatureWorld(WallWorld()), TestRig(SensorKind::kStereo), {});
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  EXPECT_NEAR((*tracker)->camera().stereo_baseline_m, 0.11, 1e-6);
  EXPECT_TRUE((*tracker)->Track(Look(0, 0), kFrame_ns).is_keyframe);
  const std::vector<Keyframe> keyframes = (*tracker)->TakeKeyframes();
  ASSERT_EQ(keyframes.size(), 1U);
  EXPECT_TRUE(Validate(keyframes.front(), (*tracker)->camera(), {}).ok());
}

}  // namespace
}  // namespace mapp::sim
