// Algorithm 1 of the paper, path by path: what a device does when it fails on its shared map.

#include "mapp/codec/query_codec.h"
#include "participant_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

TEST_F(ParticipantTest, AFailureBringsANewSharedMapAndLocalizingOnItEndsIt) {
  OpenSharing();
  Frame(1, true);
  Frame(1, false);
  ASSERT_THAT(adapter_.maps(), SizeIs(2));
  EXPECT_EQ(adapter_.maps()[1]->number, 2U);
  Frame(2, true);
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_EQ(participant_->stats().num_sharing_failures, 1U);
  EXPECT_EQ(adapter_.num_left(), 0);
  EXPECT_THAT(server_.reported(), SizeIs(0));
}

TEST_F(ParticipantTest, TheFirstTilesServeUntilTheOthersAreThere) {
  OpenAligned();
  Tile beyond = TestTile(Revision(1), 50);
  beyond.key.z = 1;
  for (TilePoint& point : beyond.points) point.p_map.z() += static_cast<float>(kDefaultTileEdgeM);
  server_.Change([&](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1)), beyond};
    script.hold_after_first_tile = true;
  });
  participant_->OnKeyframe(TestKeyframe(1, At(0.1)));
  while (adapter_.maps().empty()) std::this_thread::yield();
  EXPECT_EQ(adapter_.maps()[0]->points.size(), 300U);
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  // A failure on the part is none of the whole.
  const SharedMapFrame failed{.shared_map_number = 1, .num_matches = 3, .localized = false, .T_session_camera = {}};
  participant_->OnSharedMapFrame(failed, [] { return std::nullopt; });
  server_.Change([](FakeMapService::Script& script) { script.hold_after_first_tile = false; });
  const Status idle = participant_->WaitIdle(kPatience);
  ASSERT_TRUE(idle.ok()) << idle;
  ASSERT_THAT(adapter_.maps(), SizeIs(2));
  EXPECT_EQ(adapter_.maps()[1]->points.size(), 350U);
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(1));
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  // All further maps are still to be had.
  Frame(2, false);
  Frame(3, false);
  EXPECT_THAT(server_.reported(), SizeIs(0));
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(3));
}

TEST_F(ParticipantTest, WithoutSharingAKnownViewIsNeitherSentNorAskedFor) {
  options_.sharing = false;
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
  });
  HandIn(1);
  HandIn(2);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(0));
  EXPECT_THAT(server_.queries(), SizeIs(2)) << "it goes on asking";
  EXPECT_THAT(server_.uploads(), SizeIs(1)) << "the founding keyframe";
  EXPECT_THAT(adapter_.maps(), SizeIs(0));
  EXPECT_EQ(participant_->stats().num_skipped, 2U);
}

TEST_F(ParticipantTest, WhereTheMapIsItsOwnItGoesOnMapping) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
    script.is_own_map = true;
  });
  HandIn(1);
  ASSERT_THAT(server_.shared_map_requests(), SizeIs(1));
  EXPECT_FLOAT_EQ(server_.shared_map_requests()[0].min_seen_by_others(), 0.5F);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_THAT(adapter_.maps(), SizeIs(0));
}

TEST_F(ParticipantTest, FailingNextToItsOwnMapMeansExpanding) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.is_own_map = true; });
  Frame(1, false);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(adapter_.num_left(), 1);
  EXPECT_THAT(adapter_.maps(), SizeIs(1)) << "the one it failed on, though it still holds the tiles";
}

TEST_F(ParticipantTest, OccupancyIsAskedAndCountedLikeTheSamplers) {
  options_.sampler = SamplerKind::kOccupancy;
  OpenAligned();
  HandIn(1);
  ASSERT_THAT(server_.queries(), SizeIs(1));
  const StatusOr<ViewQuery> query = DecodeViewQuery(server_.queries()[0].view());
  ASSERT_TRUE(query.ok()) << query.status();
  EXPECT_EQ(query->sampler, SamplerKind::kOccupancy);
  EXPECT_FALSE(query->sketch.empty());
  ASSERT_THAT(server_.uploads(), SizeIs(2)) << "nothing occupied: all fresh";
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
  });
  HandIn(2);
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_DOUBLE_EQ(participant_->stats().overlap_sum, 1) << "all bins occupied: all known";
}

TEST_F(ParticipantTest, TellsHowLongEachStepTook) {
  OpenSharing();
  for (uint32_t number = 1; number <= 3; ++number) Frame(number, false);
  server_.Change([](FakeMapService::Script& script) { script.samples_redundant = false; });
  HandIn(4);
  const ParticipantStats stats = participant_->stats();
  EXPECT_EQ(stats.latency.overlap_assessment.count, stats.traffic.num_queries);
  EXPECT_EQ(stats.latency.keyframe_upload.count, stats.traffic.num_uploads);
  EXPECT_EQ(stats.latency.shared_map.count, 3U);
  EXPECT_EQ(stats.latency.update_report.count, 1U);
  EXPECT_EQ(stats.traffic.num_reports, 1U);
  EXPECT_EQ(stats.latency.redundancy_control.count, 1U) << "the seen one was not reduced";
  EXPECT_GT(stats.latency.overlap_assessment.mean_ms, 0);
  EXPECT_GT(stats.latency.redundancy_control.mean_ms, 0);
  EXPECT_GT(stats.network_cpu_s, 0);
  EXPECT_GT(stats.traffic.shared_map_request_bytes, 0U);
}

TEST_F(ParticipantTest, TilesThatTheDeviceHoldsAreNotSentAgain) {
  OpenSharing();
  const uint64_t bytes_of_one = participant_->stats().traffic.download_bytes;
  Frame(1, false);
  const v1::RequestSharedMapRequest second = server_.shared_map_requests()[1];
  ASSERT_EQ(second.held_tiles_size(), 1);
  EXPECT_EQ(second.held_tiles(0).revision(), 1U);
  EXPECT_LT(participant_->stats().traffic.download_bytes, bytes_of_one + 100);
  EXPECT_THAT(adapter_.maps()[1]->points, SizeIs(300));
}

TEST_F(ParticipantTest, AnEmptySharedMapMeansNewGround) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.tiles = {}; });
  v1::WatchSessionResponse gone;
  gone.mutable_tiles_changed()->add_keys(TileKey{}.Packed());
  gone.mutable_tiles_changed()->set_map_revision(2);
  server_.Send(gone);
  server_.Send(AlignedMessage(TestAlignment(), 77));  // once this is seen, the one before it has been, too
  while (participant_->stats().aligned_at_keyframe != 77U) std::this_thread::yield();
  Frame(1, false);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(adapter_.num_left(), 1);
  EXPECT_THAT(adapter_.maps(), SizeIs(1));
  EXPECT_THAT(server_.reported(), SizeIs(0));
}

TEST_F(ParticipantTest, AfterAllTriesTheFrameIsReportedAndNoneMeansExpanding) {
  OpenSharing();
  Frame(1, false);
  Frame(2, false);
  EXPECT_THAT(server_.reported(), SizeIs(0));
  Frame(3, false);
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(3)) << "the first, and f = 2 more";
  ASSERT_THAT(server_.reported(), SizeIs(1));
  EXPECT_EQ(server_.reported()[0].pose_frame, PoseFrame::kMap);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(adapter_.num_left(), 1);
  EXPECT_EQ(participant_->stats().num_update_reports, 1U);
  EXPECT_EQ(participant_->stats().num_sharing_failures, 1U);
  EXPECT_THAT(server_.uploads(), SizeIs(1));
}

TEST_F(ParticipantTest, ExpansionVerdictUploadsNothingByItself) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.verdict = v1::UPDATE_VERDICT_EXPANSION; });
  for (uint32_t number = 1; number <= 3; ++number) Frame(number, false);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_THAT(server_.uploads(), SizeIs(1));
}

TEST_F(ParticipantTest, UpdatingVerdictUploadsTheWholeKeyframeAsEvidence) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) {
    script.verdict = v1::UPDATE_VERDICT_UPDATING;
    script.samples_redundant = false;
  });
  for (uint32_t number = 1; number <= 3; ++number) Frame(number, false);
  ASSERT_THAT(server_.uploads(), SizeIs(2));
  const Keyframe& evidence = server_.uploads()[1];
  EXPECT_FALSE(evidence.partial);
  EXPECT_EQ(evidence.number, 2U) << "after keyframes 0 and 1";
  EXPECT_EQ(evidence.pose_frame, PoseFrame::kMap);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  // The adapter's next keyframe is its third; on the wire that number is taken.
  HandIn(2);
  ASSERT_THAT(server_.uploads(), SizeIs(3));
  EXPECT_EQ(server_.uploads()[2].number, 3U);
}

TEST_F(ParticipantTest, AFrameWithoutAKeyframeEndsSharingWithoutAReport) {
  options_.max_shared_map_tries = 0;
  OpenSharing();
  const SharedMapFrame failed{.shared_map_number = 1, .num_matches = 0, .localized = false, .T_session_camera = {}};
  participant_->OnSharedMapFrame(failed, [] { return std::nullopt; });
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_THAT(server_.reported(), SizeIs(0));
}

TEST_F(ParticipantTest, AFailureWithoutAServerGoesBackToMappingAtOnce) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.shared_map_errors = {grpc::StatusCode::UNAVAILABLE}; });
  Frame(1, false);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(adapter_.num_left(), 1);
  EXPECT_THAT(participant_->stats().last_error, HasSubstr("UNAVAILABLE"));
}

TEST_F(ParticipantTest, FramesOfAnOlderSharedMapProveNothing) {
  OpenSharing();
  Frame(1, false);
  Frame(1, false);
  Frame(1, false);
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(2));
  EXPECT_EQ(num_keyframes_asked_, 1);
}

TEST_F(ParticipantTest, ADeviceThatLocalizedAgainHasAllTriesAgain) {
  OpenSharing();
  Frame(1, false);
  Frame(2, false);
  Frame(3, true);
  Frame(3, false);
  EXPECT_THAT(server_.reported(), SizeIs(0));
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_EQ(participant_->stats().num_sharing_failures, 2U);
}

TEST_F(ParticipantTest, PosesAreOfTheMapAfterLocalizingOnIt) {
  OpenSharing();
  Frame(1, true);
  server_.Change([](FakeMapService::Script& script) {
    script.tiles = {};
    script.samples_redundant = false;
  });
  HandIn(2);
  const Keyframe& upload = server_.uploads().back();
  EXPECT_EQ(upload.pose_frame, PoseFrame::kMap);
  EXPECT_LT(Distance(upload.T_frame_camera, TestAlignment() * At(0.2)), 1e-3);
  const StatusOr<ViewQuery> query = DecodeViewQuery(server_.queries().back().view());
  ASSERT_TRUE(query.ok()) << query.status();
  EXPECT_EQ(query->pose_frame, PoseFrame::kMap);
}

}  // namespace
}  // namespace mapp
