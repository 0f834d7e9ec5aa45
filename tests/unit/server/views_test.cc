#include "tests/unit/server/views_fixture.h"

#include <gmock/gmock.h>

namespace mapp::testing {
namespace {

using ::testing::StartsWith;

using OverlapTest = ViewsTest;

TEST_F(OverlapTest, RevisitedViewIsSeen) { EXPECT_GT(Overlap(world_, seen_, session_), 0.9); }

TEST_F(OverlapTest, OppositeViewIsNot) { EXPECT_LT(Overlap(world_, opposite_, session_), 0.02); }

TEST_F(OverlapTest, WhatOnlyFramesFromBehindHaveSeenDoesNotCount) {
  // A camera inside the far wall looks back along the founder's rays: same points, opposite directions.
  const Pose3 from_behind = SyntheticWorld::Stand(0, 6, 3.14159);
  const Camera camera = SyntheticWorld::DeviceCamera();
  ViewQuery query;
  query.T_frame_camera = from_behind;
  const std::vector<Eigen::Vector3d> wall = {{0.5, -1, 2}, {-1, 1, 2}, {-0.6, 0.9, 2}, {1, 0.2, 2}};
  query.sketch = MakeDepthSketch(camera, wall);
  const StatusOr<AssessedOverlap> sampled = service_->AssessOverlap(context_, session_, query, 500);
  ASSERT_TRUE(sampled.ok());
  const std::vector<bool>& redundant = std::get<SampleStates>(sampled->answer).redundant;
  EXPECT_EQ(std::count(redundant.begin(), redundant.end(), true), 0);
  query.sampler = SamplerKind::kOccupancy;
  const StatusOr<AssessedOverlap> binned = service_->AssessOverlap(context_, session_, query, 500);
  ASSERT_TRUE(binned.ok());
  const auto& grid = std::get<OccupancyGrid>(binned->answer);
  EXPECT_GT(grid.num_bins(), 0U);
  EXPECT_EQ(grid.num_occupied(), 0U);
}

TEST_F(OverlapTest, OccupancyTellsARevisitedViewFromANewOne) {
  EXPECT_GT(Overlap(world_, seen_, session_, SamplerKind::kOccupancy), 0.9);
  EXPECT_LT(Overlap(world_, opposite_, session_, SamplerKind::kOccupancy), 0.02);
}

TEST_F(OverlapTest, OccupiedBinsAreThoseWithAPointSeenAlike) {
  const Camera camera = SyntheticWorld::DeviceCamera();
  const std::vector<Eigen::Vector3d> own = OwnPoints(world_.View(seen_, session_, 0, rng_), camera);
  ViewQuery query;
  query.T_frame_camera = seen_;
  query.sampler = SamplerKind::kOccupancy;
  query.sketch = MakeQuerySketch(query.sampler, camera, own);
  const StatusOr<AssessedOverlap> assessed = service_->AssessOverlap(context_, session_, query, 1000);
  ASSERT_TRUE(assessed.ok());
  const auto& grid = std::get<OccupancyGrid>(assessed->answer);
  // The view was mapped from here: what the device sees stands where the bins are, and nothing stands elsewhere.
  OccupancyGrid expected(query.sketch, grid.resolution());
  for (const Eigen::Vector3d& p_camera : own) {
    const std::optional<Eigen::Vector3d> location = expected.Locate(camera, p_camera);
    ASSERT_TRUE(location.has_value());
    const Eigen::Vector3i bin = location->array().floor().cast<int>();
    expected.Occupy(bin.x(), bin.y(), bin.z());
  }
  EXPECT_GT(grid.num_occupied(), 50U);
  EXPECT_LT(grid.num_occupied(), 4 * expected.num_occupied());
}

TEST_F(OverlapTest, GrowsWithTheMap) {
  const Pose3 aside = SyntheticWorld::Stand(0, -2, 1.2);
  const double before = Overlap(world_, aside, session_);
  MustUpload(world_, aside, session_, 3);
  EXPECT_LT(before, 0.5);
  EXPECT_GT(Overlap(world_, aside, session_), 0.9);
}

TEST_F(OverlapTest, UniformSamplerFindsOnlyWhereThePointsAre) {
  EXPECT_GT(Overlap(world_, seen_, session_, SamplerKind::kUniform), 0.5);
  EXPECT_LT(Overlap(world_, opposite_, session_, SamplerKind::kUniform), 0.1);
}

TEST_F(OverlapTest, EmptySketchHasNoSamples) {
  const StatusOr<AssessedOverlap> assessed = service_->AssessOverlap(context_, session_, ViewQuery{}, 1000);
  ASSERT_TRUE(assessed.ok());
  EXPECT_TRUE(std::get<SampleStates>(assessed->answer).redundant.empty());
  ViewQuery by_bins;
  by_bins.sampler = SamplerKind::kOccupancy;
  const StatusOr<AssessedOverlap> binned = service_->AssessOverlap(context_, session_, by_bins, 1000);
  ASSERT_TRUE(binned.ok());
  EXPECT_EQ(std::get<OccupancyGrid>(binned->answer).num_bins(), 0U);
}

TEST_F(OverlapTest, RefusesWhatItCannotAnswer) {
  const auto code = [&](SessionId session, const ViewQuery& query, int num_samples) {
    return service_->AssessOverlap(context_, session, query, num_samples).status().code();
  };
  EXPECT_EQ(code(SessionId(4711), {}, 10), absl::StatusCode::kNotFound);
  EXPECT_EQ(code(session_, {}, 0), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(session_, {}, 1001), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code(Open(), {}, 10), absl::StatusCode::kFailedPrecondition);
  ViewQuery far_away;
  far_away.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 2e6));
  EXPECT_EQ(code(session_, far_away, 10), absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(service_->CloseSession(context_, session_).ok());
  EXPECT_EQ(code(session_, {}, 10), absl::StatusCode::kFailedPrecondition);
}

using UpdateTest = ViewsTest;

TEST_F(UpdateTest, SameWorldNeedsNoUpdate) {
  const StatusOr<UpdateResult> result = service_->ReportUpdate(context_, session_, {Packet(world_, seen_)});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->verdict, UpdateVerdict::kNone);
  EXPECT_LT(result->new_share, 0.1);
  EXPECT_LT(result->missing_points.size(), 5U);
}

TEST_F(UpdateTest, RemovedCabinetIsMissed) {
  const SyntheticWorld emptied = world_.WithoutCabinet();
  const StatusOr<UpdateResult> result = service_->ReportUpdate(
      context_, session_, {Packet(emptied, seen_), Packet(emptied, SyntheticWorld::Stand(-0.5, -2, 0.1))});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->verdict, UpdateVerdict::kUpdating);
  EXPECT_GT(result->missing_points.size(), 30U);
  ASSERT_FALSE(result->missing_boxes.empty());
  const Aabb around_cabinet(Eigen::Vector3d(-0.9, -0.5, 2.3), Eigen::Vector3d(0.9, 1.7, 3.3));
  for (const Aabb& box : result->missing_boxes) EXPECT_TRUE(around_cabinet.contains(box));
}

TEST_F(UpdateTest, WhatTheMapsPyramidDoesNotReachIsNotMissed) {
  const Pose3 near = SyntheticWorld::Stand(0, 0.5, 0);
  const auto missing_with = [&](int num_levels) {
    const SessionId session =
        Open(SensorKind::kRgbd, "levels " + std::to_string(num_levels), {.num_levels = num_levels});
    const auto see = [&](const SyntheticWorld& world, const Pose3& T_world_camera, uint32_t number) {
      Keyframe keyframe = world.View(T_world_camera, session, number, rng_);
      std::erase_if(keyframe.features,
                    [&](const KeyframeFeature& feature) { return feature.keypoint.octave >= num_levels; });
      return keyframe;
    };
    EXPECT_TRUE(Upload(see(world_, seen_, 0)).ok());
    const StatusOr<UpdateResult> result =
        service_->ReportUpdate(context_, session, {EncodeKeyframe(see(world_.WithoutCabinet(), near, 1))});
    EXPECT_TRUE(result.ok()) << result.status();
    return result->missing_points.size();
  };
  EXPECT_GT(missing_with(kPyramidLevels), 30U);
  EXPECT_EQ(missing_with(3), 0U) << "from so near, nobody would detect the cabinet's points again";
}

TEST_F(UpdateTest, NewPlaceIsExpansion) {
  const StatusOr<UpdateResult> result = service_->ReportUpdate(context_, session_, {Packet(world_, opposite_)});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->verdict, UpdateVerdict::kExpansion);
  EXPECT_GT(result->new_share, 0.9);
  EXPECT_TRUE(result->missing_points.empty());
}

TEST_F(UpdateTest, StoresNothing) {
  const Revision before = Map().revision;
  ASSERT_TRUE(service_->ReportUpdate(context_, session_, {Packet(world_.WithoutCabinet(), seen_)}).ok());
  EXPECT_EQ(Map().revision, before);
}

TEST_F(UpdateTest, RefusesBadReports) {
  const std::string good = Packet(world_, seen_);
  const auto refuse = [&](const std::vector<std::string>& packets, const std::string& message_start) {
    const StatusOr<UpdateResult> result = service_->ReportUpdate(context_, session_, packets);
    EXPECT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(result.status().message()), StartsWith(message_start));
  };
  refuse({}, "keyframes: ");
  refuse(std::vector<std::string>(9, good), "keyframes: ");
  refuse({good, good.substr(0, 100)}, "keyframes[1]");
  refuse({EncodeKeyframe(world_.View(seen_, Open(), 0, rng_))}, "keyframes[0].session_id: ");
}

}  // namespace
}  // namespace mapp::testing
