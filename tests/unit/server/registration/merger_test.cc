#include "server/service/merger.h"

#include "server/service/duplicate_points.h"
#include "server/service/session_view.h"
#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <map>

namespace mapp {
namespace {

using testing::EventLog;
using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

class MergerTest : public ::testing::Test {
 protected:
  MergerTest() {
    founder_poses_ = SyntheticRoom::Circle(0.5, 0, 0.3, 6);
    const SessionId founder = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true);
    for (uint32_t i = 0; i < founder_poses_.size(); ++i) StoreKeyframe(founder, founder_poses_, i);
    session_ = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/false);
    poses_ = SyntheticRoom::Circle(0.7, 0.5, 0.15, 4);
    for (uint32_t i = 0; i < 3; ++i) StoreKeyframe(session_, poses_, i);
    T_map_session_ = founder_poses_.front().Inverse() * poses_.front();
  }

  void StoreKeyframe(SessionId session, const std::vector<Pose3>& poses, uint32_t number) {
    fixture_.Store(session, room_.View(poses[number], poses.front(), session, number, ViewNoise(), rng_));
  }

  std::vector<FrameRecord> AllFrames() {
    const auto frames = fixture_.Read()->ListFrames(fixture_.map(), std::nullopt);
    EXPECT_TRUE(frames.ok()) << frames.status();
    return *frames;
  }

  Status Merge(const PointFusions& fusions) {
    return MergeFragment(fixture_.store(), fixture_.tiles(), fixture_.events(), {}, session_,
                         {.S_map_session = {1, T_map_session_}}, fusions);
  }

  MapFixture fixture_;
  SyntheticRoom room_{1};
  Rng rng_{8};
  std::vector<Pose3> founder_poses_;
  std::vector<Pose3> poses_;
  SessionId session_;
  Pose3 T_map_session_;
};

TEST_F(MergerTest, PairsPointsOfTheSameLandmark) {
  const auto reader = fixture_.Read();
  const auto fusions = FindFusions(*reader, session_, {1, T_map_session_});
  ASSERT_TRUE(fusions.ok()) << fusions.status();
  ASSERT_GT(fusions->size(), 200U);
  size_t num_right = 0;
  for (const auto& [own, target] : *fusions) {
    const auto points = reader->GetPoints(std::vector<MapPointId>{own, target});
    ASSERT_TRUE(points.ok()) << points.status();
    // Both sessions number points by landmark.
    if ((*points)[0].session_point == (*points)[1].session_point) ++num_right;
  }
  EXPECT_GT(static_cast<double>(num_right), 0.99 * static_cast<double>(fusions->size()));
}

TEST_F(MergerTest, TakesAlongKeyframesStoredAfterTheDecision) {
  const auto fusions = FindFusions(*fixture_.Read(), session_, {1, T_map_session_});
  ASSERT_TRUE(fusions.ok()) << fusions.status();
  StoreKeyframe(session_, poses_, 3);
  const Status merged = Merge(*fusions);
  ASSERT_TRUE(merged.ok()) << merged;

  const std::vector<FrameRecord> frames = fixture_.Frames(session_);
  ASSERT_EQ(frames.size(), 4U);
  for (const FrameRecord& frame : frames) {
    EXPECT_TRUE(frame.in_map);
    EXPECT_LT(Distance(frame.T_frame_camera, founder_poses_.front().Inverse() * poses_[frame.number]), 1e-3);
  }
  EXPECT_EQ(fixture_.Session(session_).aligned_at_keyframe, 3U);
  const auto points = fixture_.Read()->PointsOfSession(session_);
  ASSERT_TRUE(points.ok());
  for (const PointRecord& point : *points) EXPECT_TRUE(point.in_map);
}

TEST_F(MergerTest, TellsTheSessionAndTheMap) {
  EventLog log(fixture_, session_);
  ASSERT_TRUE(Merge({}).ok());
  EXPECT_EQ(log.Count<SessionAligned>(), 1U);
  const auto changed = log.WaitFor<TilesChanged>(0);
  ASSERT_TRUE(changed);
  EXPECT_FALSE(changed->keys.empty());
}

TEST_F(MergerTest, TakesASessionWithoutScaleAtItsScale) {
  constexpr double kUnitM = 0.25;
  const SessionId mono = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/false, SensorKind::kMono);
  for (uint32_t i = 0; i < 2; ++i) {
    Keyframe keyframe = room_.View(poses_[i], poses_.front(), mono, i, ViewNoise(), rng_);
    ScaleLengths(keyframe, 1 / kUnitM);
    fixture_.Store(mono, keyframe);
  }
  const Placement placement{.S_map_session = {kUnitM, T_map_session_}};
  const Status merged = MergeFragment(fixture_.store(), fixture_.tiles(), fixture_.events(), {}, mono, placement, {});
  ASSERT_TRUE(merged.ok()) << merged;
  ASSERT_TRUE(Merge({}).ok());  // the same keyframes in metres
  EXPECT_EQ(fixture_.Session(mono).scale_map_session, kUnitM);
  for (const FrameRecord& frame : fixture_.Frames(mono)) {
    EXPECT_LT(Distance(frame.T_frame_camera, T_map_session_ * poses_.front().Inverse() * poses_[frame.number]), 1e-9);
  }
  const auto points = fixture_.Read()->PointsOfSession(mono);
  const auto metric_points = fixture_.Read()->PointsOfSession(session_);
  ASSERT_TRUE(points.ok() && metric_points.ok());
  std::map<uint64_t, PointRecord> metric;
  for (const PointRecord& point : *metric_points) metric.emplace(point.session_point, point);
  size_t num_compared = 0;
  for (const PointRecord& point : *points) {
    const auto same = metric.find(point.session_point);  // both number them by landmark
    if (same == metric.end()) continue;
    ++num_compared;
    EXPECT_LT((point.position - same->second.position).norm(), 0.2);
    EXPECT_NEAR(point.reference_distance_m / same->second.reference_distance_m, 1, 0.15);
  }
  EXPECT_GT(num_compared, 100U);
}

TEST_F(MergerTest, LeavesWhatWasPlacedInAnotherUnit) {
  const Placement stale{.S_map_session = {1, T_map_session_}, .map_unit = 1.5};
  const Status merged = MergeFragment(fixture_.store(), fixture_.tiles(), fixture_.events(), {}, session_, stale, {});
  EXPECT_EQ(merged.code(), absl::StatusCode::kAborted);
  EXPECT_FALSE(fixture_.Session(session_).T_map_session);
}

TEST_F(MergerTest, MergesOnce) {
  ASSERT_TRUE(Merge({}).ok());
  const Pose3 before = fixture_.Frames(session_)[1].T_frame_camera;
  EventLog log(fixture_, session_);
  ASSERT_TRUE(Merge({}).ok());
  EXPECT_EQ(log.Count<SessionAligned>(), 0U);
  EXPECT_LT(Distance(fixture_.Frames(session_)[1].T_frame_camera, before), 1e-12);
}

TEST_F(MergerTest, LeavesOutTargetsRetiredMeanwhile) {
  const auto fusions = FindFusions(*fixture_.Read(), session_, {1, T_map_session_});
  ASSERT_TRUE(fusions.ok());
  const auto [own, target] = *fusions->begin();
  const MapPointId retired = target;
  const Status status =
      fixture_.store().Write({}, [retired](MapWriter& writer) { return writer.RetirePoint(retired, std::nullopt); });
  ASSERT_TRUE(status.ok()) << status;
  ASSERT_TRUE(Merge(*fusions).ok());
  const MapPointId kept = own;
  const auto points = fixture_.Read()->GetPoints(std::span(&kept, 1));
  ASSERT_TRUE(points.ok()) << points.status();
  EXPECT_TRUE(points->front().in_map);
}

TEST_F(MergerTest, WhatWasNotFusedIsFoundInTheMap) {
  ASSERT_TRUE(Merge({}).ok());
  const auto reader = fixture_.Read();
  const auto fusions = FindDuplicatePoints({}, *reader, AllFrames());
  ASSERT_TRUE(fusions.ok()) << fusions.status();
  ASSERT_GT(fusions->size(), 200U);
  size_t num_right = 0;
  for (const auto& [point, target] : *fusions) {
    EXPECT_FALSE(fusions->contains(target)) << "a point that goes cannot take another's place";
    const auto points = reader->GetPoints(std::vector<MapPointId>{point, target});
    ASSERT_TRUE(points.ok()) << points.status();
    if ((*points)[0].session_point == (*points)[1].session_point) ++num_right;
  }
  EXPECT_GT(static_cast<double>(num_right), 0.99 * static_cast<double>(fusions->size()));
}

TEST_F(MergerTest, DuplicatesBecomeOnePointThatTheFramesOfBothSee) {
  ASSERT_TRUE(Merge({}).ok());
  const auto fusions = FindDuplicatePoints({}, *fixture_.Read(), AllFrames());
  ASSERT_TRUE(fusions.ok()) << fusions.status();
  std::vector<std::vector<Observation>> before;
  const std::vector<FrameRecord> frames = fixture_.Frames(session_);
  for (const FrameRecord& frame : frames) before.push_back(*fixture_.Read()->GetObservations(frame.id));

  DuplicateFusion fusion(fixture_.map(), *fusions);
  const Status fused = fixture_.store().Write({}, [&fusion](MapWriter& writer) { return fusion.Run(writer); });
  ASSERT_TRUE(fused.ok()) << fused;
  EXPECT_EQ(fusion.num_fused(), fusions->size());
  EXPECT_FALSE(fusion.touched_tiles().empty());

  const auto reader = fixture_.Read();
  for (size_t i = 0; i < frames.size(); ++i) {
    const auto after = reader->GetObservations(frames[i].id);
    ASSERT_TRUE(after.ok()) << after.status();
    ASSERT_EQ(after->size(), before[i].size());
    for (size_t k = 0; k < before[i].size(); ++k) {
      const auto fused_into = fusions->find(before[i][k].point);
      EXPECT_EQ((*after)[k].feature_idx, before[i][k].feature_idx);
      EXPECT_EQ((*after)[k].point, fused_into == fusions->end() ? before[i][k].point : fused_into->second);
    }
  }
  const auto again = FindDuplicatePoints({}, *reader, AllFrames());
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_LT(again->size(), fusions->size() / 20);
}

}  // namespace
}  // namespace mapp
