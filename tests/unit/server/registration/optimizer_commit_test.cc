#include "server/service/optimizer_commit.h"

#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mapp {
namespace {

using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

constexpr double kToleranceM = 1e-6;

/// A session in the map, and an "adjustment" that moves all that is free by the same known motion.
class OptimizerCommitTest : public ::testing::Test {
 protected:
  OptimizerCommitTest() : session_(fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true)) {
    poses_ = SyntheticRoom::Circle(0.5, 0, 0.15, 8);
    for (uint32_t i = 0; i < 6; ++i) StoreKeyframe(i);
    auto region = LoadOptimizerRegion({}, *fixture_.Read(), fixture_.Frames(session_), OptimizerOptions());
    EXPECT_TRUE(region.ok()) << region.status();
    region_ = *std::move(region);
    adjusted_ = region_.problem;
    for (BundleProblem::Frame& frame : adjusted_.frames) {
      if (!frame.fixed) frame.T_world_camera = kMotion * frame.T_world_camera;
    }
    for (BundleProblem::Point& point : adjusted_.points) point.p_world = kMotion * point.p_world;
    outliers_.assign(adjusted_.observations.size(), false);
  }

  FrameId StoreKeyframe(uint32_t number) {
    return fixture_.Store(session_, room_.View(poses_[number], poses_.front(), session_, number, ViewNoise(), rng_));
  }

  Status Commit() {
    OptimizerCommit commit(region_, adjusted_, outliers_);
    return fixture_.store().Write({}, [&commit](MapWriter& writer) { return commit.Run(writer); });
  }

  PointRecord Point(MapPointId point) {
    const auto points = fixture_.Read()->GetPoints(std::span(&point, 1));
    EXPECT_TRUE(points.ok()) << points.status();
    return points->front();
  }

  const Pose3 kMotion{Eigen::Quaterniond(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY())), {0.05, -0.02, 0.03}};
  MapFixture fixture_;
  SyntheticRoom room_{1};
  Rng rng_{4};
  SessionId session_;
  std::vector<Pose3> poses_;
  OptimizerRegion region_;
  BundleProblem adjusted_;
  std::vector<bool> outliers_;
};

TEST_F(OptimizerCommitTest, WritesPosesAndPoints) {
  ASSERT_TRUE(Commit().ok());
  const std::vector<FrameRecord> frames = fixture_.Frames(session_);
  for (size_t i = 0; i < region_.frames.size(); ++i) {
    const auto now = std::find_if(frames.begin(), frames.end(),
                                  [&](const FrameRecord& frame) { return frame.id == region_.frames[i].id; });
    EXPECT_LT(Distance(now->T_frame_camera, adjusted_.frames[i].T_world_camera), kToleranceM);
  }
  EXPECT_LT((Point(region_.points[0].id).position - adjusted_.points[0].p_world).norm(), kToleranceM);
}

TEST_F(OptimizerCommitTest, PointsThatOneFrameSeesMoveWithIt) {
  const auto carried =
      std::find_if(region_.carried_points.begin(), region_.carried_points.end(), [this](const auto& point) {
        return std::any_of(region_.frames.begin(), region_.frames.end(),
                           [&](const FrameRecord& frame) { return frame.id == point.frame && frame.number > 0; });
      });
  ASSERT_NE(carried, region_.carried_points.end());
  ASSERT_TRUE(Commit().ok());
  EXPECT_LT((Point(carried->record.id).position - kMotion * carried->record.position).norm(), kToleranceM);
}

TEST_F(OptimizerCommitTest, CarriesFramesAndPointsThatArrivedMeanwhile) {
  const FrameId arrived = StoreKeyframe(6);
  const auto before = fixture_.Read()->GetFrame(arrived);
  ASSERT_TRUE(before.ok());
  const auto observations = fixture_.Read()->GetObservations(arrived);
  ASSERT_TRUE(observations.ok());
  const auto fresh = std::find_if(observations->begin(), observations->end(), [this](const Observation& observation) {
    return !region_.known_points.contains(observation.point);
  });
  ASSERT_NE(fresh, observations->end());
  const Eigen::Vector3d p_before = Point(fresh->point).position;

  ASSERT_TRUE(Commit().ok());
  const auto after = fixture_.Read()->GetFrame(arrived);
  ASSERT_TRUE(after.ok());
  EXPECT_LT(Distance(after->T_frame_camera, kMotion * before->T_frame_camera), kToleranceM);
  EXPECT_LT((Point(fresh->point).position - kMotion * p_before).norm(), kToleranceM);
}

TEST_F(OptimizerCommitTest, GivesWayToWhoMovedAFrameMeanwhile) {
  const FrameRecord frame = fixture_.Frames(session_)[2];
  const Status moved = fixture_.store().Write({}, [&](MapWriter& writer) {
    return writer.SetFramePose(frame.id, /*in_map=*/true, kMotion * frame.T_frame_camera);
  });
  ASSERT_TRUE(moved.ok()) << moved;
  EXPECT_EQ(Commit().code(), absl::StatusCode::kAborted);
  EXPECT_LT(Distance(fixture_.Frames(session_)[3].T_frame_camera, region_.frames[3].T_frame_camera), kToleranceM)
      << "nothing of it is written";
}

TEST_F(OptimizerCommitTest, DropsWrongObservations) {
  outliers_[0] = true;
  const FrameId frame = region_.frames[region_.problem.observations[0].frame_idx].id;
  const auto before = fixture_.Read()->GetObservations(frame);
  ASSERT_TRUE(before.ok());
  ASSERT_TRUE(Commit().ok());
  const auto after = fixture_.Read()->GetObservations(frame);
  ASSERT_TRUE(after.ok());
  EXPECT_EQ(after->size() + 1, before->size());
  EXPECT_TRUE(std::none_of(after->begin(), after->end(), [this](const Observation& observation) {
    return observation.point == region_.observations[0].point;
  }));
}

}  // namespace
}  // namespace mapp
