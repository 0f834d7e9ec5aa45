#include "api/convert/convert.h"
#include "participant_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

TEST_F(ParticipantTest, RegistersWithWholeKeyframes) {
  Open();
  const Keyframe whole = TestKeyframe(0, At(0));
  participant_->OnKeyframe(whole);
  server_.Send(TriedMessage(0));
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(participant_->state(), ParticipantState::kRegistering);
  ASSERT_THAT(server_.uploads(), SizeIs(1));
  EXPECT_FALSE(server_.uploads()[0].partial);
  EXPECT_EQ(server_.uploads()[0].session, SessionId(FakeMapService::kSession));
  EXPECT_EQ(server_.uploads()[0].features.size(), whole.features.size());
  EXPECT_THAT(server_.queries(), SizeIs(0));
}

TEST_F(ParticipantTest, IsNotIdleWhileTheServerCompares) {
  Open();
  participant_->OnKeyframe(TestKeyframe(0, At(0)));
  const Status waiting = participant_->WaitIdle(kShortWait);
  EXPECT_EQ(waiting.code(), absl::StatusCode::kDeadlineExceeded);
  server_.Send(TriedMessage(0));
  EXPECT_TRUE(participant_->WaitIdle(kPatience).ok());
}

TEST_F(ParticipantTest, AlignsByEventAndThenAsksFirst) {
  Open();
  participant_->OnKeyframe(TestKeyframe(0, At(0)));
  while (server_.uploads().empty()) std::this_thread::yield();
  server_.Send(AlignedMessage(TestAlignment(), 0));
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(participant_->stats().aligned_at_keyframe, 0U);
  ASSERT_TRUE(participant_->T_map_session().has_value());
  EXPECT_LT(Distance(*participant_->T_map_session(), TestAlignment()), 1e-9);
  HandIn(1);
  ASSERT_THAT(server_.queries(), SizeIs(2));
  // The upload that aligned the session is asked about afterwards.
  EXPECT_EQ(server_.queries()[0].keyframe(), 0U);
  EXPECT_EQ(server_.queries()[1].keyframe(), 1U);
}

TEST_F(ParticipantTest, WhereAlignmentFindsTheMapKnownSharingBeginsAtOnce) {
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
  });
  Open();
  participant_->OnKeyframe(TestKeyframe(0, At(0)));
  while (server_.uploads().empty()) std::this_thread::yield();
  server_.Send(AlignedMessage(TestAlignment(), 0));
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_THAT(adapter_.maps(), SizeIs(1));
}

TEST_F(ParticipantTest, MissedComparisonsAreNotWaitedForAfterAReconnect) {
  Open();
  participant_->OnKeyframe(TestKeyframe(0, At(0)));
  ASSERT_FALSE(participant_->WaitIdle(kShortWait).ok());
  server_.BreakWatch();
  EXPECT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(server_.num_watches(), 2);
}

TEST_F(ParticipantTest, ExpandsWithTheFreshPart) {
  OpenAligned();
  HandIn(1);
  ASSERT_THAT(server_.uploads(), SizeIs(2));
  const Keyframe& partial = server_.uploads()[1];
  EXPECT_TRUE(partial.partial);
  EXPECT_EQ(partial.pose_frame, PoseFrame::kSession);
  EXPECT_EQ(partial.overlap, 0.0F);
  EXPECT_THAT(partial.features, SizeIs(200)) << "all points are fresh; features without a point stay at home";
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_EQ(participant_->stats().num_overlaps, 1U);
}

TEST_F(ParticipantTest, QueriesAreTheSizeTheContractPromises) {
  OpenAligned();
  HandIn(1);
  EXPECT_LE(participant_->stats().traffic.max_query_bytes, 64U);
  EXPECT_LE(participant_->stats().traffic.max_response_bytes, 200U);
}

TEST_F(ParticipantTest, SeenTakesTheSharedMapInTheSessionsFrame) {
  OpenSharing();
  ASSERT_THAT(adapter_.maps(), SizeIs(1));
  const SharedMap& map = *adapter_.maps()[0];
  EXPECT_EQ(map.number, 1U);
  ASSERT_THAT(map.points, SizeIs(300));
  for (const SharedPoint& point : map.points) {
    const Eigen::Vector2d pixel = TestCamera().Project(point.p_session);
    EXPECT_TRUE(TestCamera().Contains(pixel)) << point.p_session.transpose();
  }
  EXPECT_THAT(server_.uploads(), SizeIs(1)) << "what the map knows is not sent";
  EXPECT_EQ(participant_->stats().num_skipped, 1U);
}

TEST_F(ParticipantTest, KeyframesThatCameBeforeTheSharedMapAreStillSent) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.samples_redundant = false; });
  HandIn(2);
  EXPECT_THAT(server_.uploads(), SizeIs(2));
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
}

TEST_F(ParticipantTest, LocalizedFramesKeepSharing) {
  OpenSharing();
  for (int i = 0; i < 5; ++i) Frame(1, true);
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(1));
  EXPECT_EQ(num_keyframes_asked_, 1) << "of what the first saw; the others stood there, too";
}

TEST_F(ParticipantTest, UploadAllNeverAsksAndNeverShares) {
  options_.policy = UploadPolicy::kUploadAll;
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.samples_redundant = true; });
  HandIn(1);
  HandIn(2);
  EXPECT_THAT(server_.queries(), SizeIs(0));
  ASSERT_THAT(server_.uploads(), SizeIs(3));
  for (const Keyframe& upload : server_.uploads()) EXPECT_FALSE(upload.partial);
  const ParticipantStats stats = participant_->stats();
  // The envelope of the message is all that uploads carry beyond the packets.
  EXPECT_NEAR(static_cast<double>(stats.traffic.upload_bytes), static_cast<double>(stats.full.bytes), 3 * 8);
  EXPECT_EQ(stats.full.num_keyframes, 3U);
}

TEST_F(ParticipantTest, ASingleCameraSendsAllAndIsToldItsScale) {
  Open(SensorKind::kMono);
  server_.Change([](FakeMapService::Script& script) { script.samples_redundant = true; });
  participant_->OnKeyframe(TestKeyframe(0, At(0)));
  while (server_.uploads().empty()) std::this_thread::yield();
  EXPECT_FALSE(participant_->S_map_session().has_value());
  v1::WatchSessionResponse aligned = AlignedMessage(TestAlignment(), 0);
  aligned.mutable_aligned()->set_scale_map_session(2.5);
  server_.Send(aligned);
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  HandIn(1);
  // What it would ask, and be sent, is in the map's unit of length.
  EXPECT_THAT(server_.queries(), SizeIs(0));
  ASSERT_THAT(server_.uploads(), SizeIs(2));
  EXPECT_FALSE(server_.uploads().back().partial);
  EXPECT_EQ(server_.uploads().back().pose_frame, PoseFrame::kSession);

  const std::optional<Sim3> S_map_session = participant_->S_map_session();
  ASSERT_TRUE(S_map_session);
  EXPECT_EQ(S_map_session->scale, 2.5);
  EXPECT_EQ(participant_->fragments().front().scale_map_session, 2.5);
  const Pose3 T_map_camera = *S_map_session * At(0.1);
  EXPECT_LT(Distance(T_map_camera, TestAlignment() * At(0.25)), 1e-9);

  v1::WatchSessionResponse corrected;
  *corrected.mutable_corrected()->mutable_pose_map_session() = ToProto(At(1));
  corrected.mutable_corrected()->set_scale_map_session(2.6);
  server_.Send(corrected);
  while (participant_->S_map_session()->scale != 2.6) std::this_thread::yield();
  EXPECT_LT(Distance(*participant_->T_map_session(), At(1)), 1e-9);
}

TEST_F(ParticipantTest, CloseSendsWhatIsQueuedAndWaitsForTheOptimisation) {
  server_.Change([](FakeMapService::Script& script) {
    script.T_map_session = TestAlignment();
    script.optimization_pending = true;
  });
  Open();
  for (uint32_t number = 0; number < 5; ++number) participant_->OnKeyframe(TestKeyframe(number, At(number)));
  v1::WatchSessionResponse optimized;
  optimized.mutable_optimized()->set_applied(true);
  server_.Send(optimized);
  const Status closed = participant_->Close(kPatience, true);
  EXPECT_TRUE(closed.ok()) << closed;
  EXPECT_THAT(server_.uploads(), SizeIs(5));
  EXPECT_EQ(participant_->state(), ParticipantState::kClosed);
  EXPECT_EQ(server_.num_closes(), 1);
}

TEST_F(ParticipantTest, CloseSaysWhenTheOptimisationTakesLonger) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.optimization_pending = true; });
  EXPECT_EQ(participant_->Close(kShortWait, true).code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(participant_->state(), ParticipantState::kClosed);
}

TEST_F(ParticipantTest, ClosingOutlivesAServerThatComesBackWithTheOptimisationDone) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.optimization_pending = true; });
  std::thread restart([this] {
    while (server_.num_closes() == 0) std::this_thread::yield();
    server_.Change([](FakeMapService::Script& script) { script.optimization_pending = false; });
    server_.BreakWatch();
  });
  const Status closed = participant_->Close(kPatience, true);
  restart.join();
  EXPECT_TRUE(closed.ok()) << closed;
  EXPECT_EQ(server_.num_closes(), 2);
}

TEST_F(ParticipantTest, KeyframesAfterCloseAreDropped) {
  OpenAligned();
  ASSERT_TRUE(participant_->Close(kPatience, false).ok());
  participant_->OnKeyframe(TestKeyframe(5, At(0)));
  EXPECT_EQ(participant_->stats().num_dropped, 1U);
}

TEST_F(ParticipantTest, KeyframesOfOtherSettingsThanToldAreNotSent) {
  options_.features.num_levels = 3;
  Open();
  Keyframe keyframe = TestKeyframe(0, At(0));
  keyframe.features[2].keypoint.octave = 3;
  participant_->OnKeyframe(keyframe);
  ASSERT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(participant_->stats().num_rejected, 1U);
  EXPECT_THAT(participant_->stats().last_error, HasSubstr("keyframe.features[2].octave: must be below num_levels 3"));
  EXPECT_EQ(server_.num_upload_attempts(), 0);
}

TEST_F(ParticipantTest, OptionsAreCheckedByName) {
  options_.num_samples = 1001;
  auto opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
  EXPECT_THAT(opened.status().ToString(), HasSubstr("num_samples: "));
  options_.num_samples = 1000;
  options_.features.patch_size_px = 0;
  opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
  EXPECT_THAT(opened.status().ToString(), HasSubstr("feature_settings.patch_size_px: "));
  options_.features = {};
  opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, nullptr);
  EXPECT_THAT(opened.status().ToString(), HasSubstr("adapter: "));
}

}  // namespace
}  // namespace mapp
