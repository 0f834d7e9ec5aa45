// A device that has lost its place for good goes on in another session.

#include "mapp/client/device.h"
#include "participant_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

namespace mapp {
namespace {

using grpc::StatusCode;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

constexpr uint32_t kFirst = FakeMapService::kSession;
constexpr uint32_t kSecond = kFirst + 1;

class ParticipantFragmentsTest : public ParticipantTest {
 protected:
  void Queue(uint32_t number) { participant_->OnKeyframe(TestKeyframe(number, At(0.1 * number))); }
  void ExpectIdle() {
    const Status idle = participant_->WaitIdle(kPatience);
    EXPECT_TRUE(idle.ok()) << idle;
  }
  /// Two keyframes make a fragment worth a session.
  void BeginFragmentOfTwo() {
    participant_->BeginFragment();
    Queue(0);
    Queue(1);
  }
  std::vector<uint32_t> UploadedNumbers(uint32_t session) const {
    std::vector<uint32_t> numbers;
    for (const Keyframe& upload : server_.uploads()) {
      if (upload.session == SessionId(session)) numbers.push_back(upload.number);
    }
    return numbers;
  }
  void StayUnaligned() {
    server_.Change([](FakeMapService::Script& script) { script.T_map_session = std::nullopt; });
  }
};

TEST_F(ParticipantFragmentsTest, PosesInTheMapComeOfEachFragmentAlsoAfterTheEnd) {
  OpenAligned();
  Queue(1);
  BeginFragmentOfTwo();
  ExpectIdle();
  server_.Change([](FakeMapService::Script& script) { script.T_corrected_sent = Pose3(); });
  ASSERT_TRUE(participant_->Close(kPatience, /*wait_for_optimization=*/false).ok());
  std::vector<DeviceFragment> fragments;
  for (const ParticipantFragment& fragment : participant_->fragments()) fragments.push_back({fragment, {}, {}});
  ASSERT_THAT(fragments, SizeIs(2));
  const Status fetched = FetchKeyframePoses(*participant_, fragments);
  ASSERT_TRUE(fetched.ok()) << fetched;
  EXPECT_THAT(fragments[0].keyframe_poses, SizeIs(2));
  EXPECT_THAT(fragments[1].keyframe_poses, SizeIs(2));
}

TEST_F(ParticipantFragmentsTest, AFragmentWithoutAPlaceIsNotAskedFor) {
  StayUnaligned();
  Open();
  Queue(0);
  const auto poses = participant_->FetchKeyframePoses();  // the server would refuse
  ASSERT_TRUE(poses.ok()) << poses.status();
  ASSERT_THAT(*poses, SizeIs(1));
  EXPECT_THAT(poses->front(), SizeIs(0));
}

TEST_F(ParticipantFragmentsTest, EverySessionTellsTheFeatureSettings) {
  options_.features = {.descriptor_kind = "BEBLID-256", .scale_factor = 1.25F, .num_levels = 3, .patch_size_px = 41};
  OpenAligned();
  BeginFragmentOfTwo();
  ExpectIdle();
  const std::vector<v1::OpenSessionRequest> opened = server_.opened();
  ASSERT_THAT(opened, SizeIs(2));
  for (const v1::OpenSessionRequest& request : opened) {
    EXPECT_EQ(request.feature_settings().descriptor_kind(), "BEBLID-256");
    EXPECT_EQ(request.feature_settings().scale_factor(), 1.25F);
    EXPECT_EQ(request.feature_settings().num_levels(), 3U);
    EXPECT_EQ(request.feature_settings().patch_size_px(), 41U);
  }
}

TEST_F(ParticipantFragmentsTest, TheOldSessionIsSentToItsEndAndClosedAndANewOneOpened) {
  OpenAligned();
  for (uint32_t number = 1; number < 4; ++number) Queue(number);
  BeginFragmentOfTwo();
  Queue(2);
  ExpectIdle();
  EXPECT_THAT(UploadedNumbers(kFirst), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(UploadedNumbers(kSecond), ElementsAre(0, 1, 2)) << "numbered from 0 again";
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst));
  EXPECT_EQ(participant_->session(), SessionId(kSecond));

  const std::vector<ParticipantFragment> fragments = participant_->fragments();
  ASSERT_THAT(fragments, SizeIs(2));
  EXPECT_EQ(fragments[0].session, SessionId(kFirst));
  EXPECT_EQ(fragments[0].state, ParticipantState::kClosed);
  EXPECT_EQ(fragments[0].stats.num_uploaded, 4U);
  EXPECT_EQ(fragments[1].stats.num_uploaded, 3U);
  const ParticipantStats stats = participant_->stats();
  EXPECT_EQ(stats.num_uploaded, 7U);
  EXPECT_EQ(stats.traffic.num_uploads, 7U);
  EXPECT_EQ(stats.latency.keyframe_upload.count, 7U);

  ASSERT_TRUE(participant_->Close(kPatience, true).ok());
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst, kSecond));
}

TEST_F(ParticipantFragmentsTest, TheAlignmentOfOneFragmentIsNotTheNexts) {
  OpenAligned();
  StayUnaligned();
  BeginFragmentOfTwo();
  EXPECT_FALSE(participant_->T_map_session().has_value());
  EXPECT_EQ(participant_->state(), ParticipantState::kRegistering);
  server_.Send(TriedMessage(1), kSecond);
  ExpectIdle();
  EXPECT_FALSE(participant_->T_map_session().has_value());
  EXPECT_TRUE(participant_->fragments()[0].T_map_session.has_value());
  // Whole keyframes, as of any session whose place is not known.
  EXPECT_FALSE(server_.uploads().back().partial);

  const Pose3 T_map_second(Eigen::Quaterniond::Identity(), {1, 2, 3});
  server_.Send(AlignedMessage(T_map_second, 1), kSecond);
  while (!participant_->T_map_session()) std::this_thread::yield();
  EXPECT_LT(Distance(*participant_->T_map_session(), T_map_second), 1e-9);
  EXPECT_LT(Distance(*participant_->fragments()[0].T_map_session, TestAlignment()), 1e-9);
}

TEST_F(ParticipantFragmentsTest, AFragmentThatEndsWhileRegisteringMayBeAlignedLater) {
  Open();
  Queue(0);
  BeginFragmentOfTwo();
  server_.Send(TriedMessage(1), kSecond);
  ExpectIdle();
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst));
  EXPECT_FALSE(participant_->fragments()[0].T_map_session.has_value());
  server_.Send(AlignedMessage(TestAlignment(), 0), kFirst);
  while (!participant_->fragments()[0].T_map_session) std::this_thread::yield();
  EXPECT_EQ(participant_->fragments()[0].state, ParticipantState::kClosed);
  EXPECT_FALSE(participant_->T_map_session().has_value());
  EXPECT_THAT(server_.shared_map_requests(), SizeIs(0)) << "nobody is left to use one";
}

TEST_F(ParticipantFragmentsTest, NoMapOfAnEndedFragmentReachesTheAdapter) {
  OpenSharing();
  ASSERT_THAT(adapter_.maps(), SizeIs(1));
  server_.Change([](FakeMapService::Script& script) { script.hold_shared_maps = true; });
  const SharedMapFrame failed{.shared_map_number = 1, .num_matches = 3, .localized = false, .T_session_camera = {}};
  participant_->OnSharedMapFrame(failed, [] { return std::optional<Keyframe>(); });
  while (server_.shared_map_requests().size() < 2) std::this_thread::yield();
  participant_->BeginFragment();
  server_.Change([](FakeMapService::Script& script) { script.hold_shared_maps = false; });
  ExpectIdle();
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst));
  EXPECT_THAT(adapter_.maps(), SizeIs(1));
  EXPECT_EQ(adapter_.num_left(), 0);
}

TEST_F(ParticipantFragmentsTest, TheNewFragmentSharesTheMapOnceItIsAligned) {
  OpenSharing();
  BeginFragmentOfTwo();
  ExpectIdle();
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  ASSERT_THAT(adapter_.maps(), SizeIs(2));
  EXPECT_EQ(server_.shared_map_requests().back().session_id(), kSecond);
  EXPECT_EQ(server_.shared_map_requests().back().held_tiles_size(), 0) << "what the old session held is gone";
}

TEST_F(ParticipantFragmentsTest, WithoutAServerKeyframesQueueAndTheSessionIsOpenedWhenItIsBack) {
  client_options_.retry_for = std::chrono::milliseconds(20);
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) {
    // More than one round of the client's own retries takes.
    script.open_errors.assign(100, StatusCode::UNAVAILABLE);
    script.close_errors.assign(100, StatusCode::UNAVAILABLE);
  });
  BeginFragmentOfTwo();
  while (server_.num_open_attempts() < 12 || server_.num_closes() < 12) std::this_thread::yield();
  EXPECT_FALSE(participant_->session().has_value());
  EXPECT_FALSE(participant_->WaitIdle(kShortWait).ok());
  server_.Change([](FakeMapService::Script& script) {
    script.open_errors.clear();
    script.close_errors.clear();
  });
  ExpectIdle();
  EXPECT_THAT(UploadedNumbers(kSecond), ElementsAre(0, 1));
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst));
  EXPECT_EQ(participant_->stats().num_dropped, 0U);
}

TEST_F(ParticipantFragmentsTest, WhileTheServerIsAwayTheOldestOfAFullQueueIsDropped) {
  options_.max_queued_keyframes = 3;
  OpenAligned();
  server_.Stop();
  participant_->BeginFragment();
  for (uint32_t number = 0; number < 10; ++number) Queue(number);
  EXPECT_EQ(participant_->fragments()[1].stats.num_dropped, 7U);
  EXPECT_EQ(participant_->Close(kShortWait, false).code(), absl::StatusCode::kDeadlineExceeded);
  // The participant goes while its session is being opened: the test ends only if that ends, too.
}

TEST_F(ParticipantFragmentsTest, AServerThatWillNotHaveTheNewSessionSaysWhy) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.open_errors = {StatusCode::FAILED_PRECONDITION}; });
  BeginFragmentOfTwo();
  const Status closed = participant_->Close(kPatience, false);
  EXPECT_EQ(closed.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(closed.ToString(), HasSubstr("opening the session of a new fragment"));
  Queue(2);
  EXPECT_EQ(participant_->stats().num_rejected, 3U);
  EXPECT_THAT(participant_->stats().last_error, HasSubstr("FAILED_PRECONDITION"));
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kFirst));
}

TEST_F(ParticipantFragmentsTest, AnOldSessionThatTheServerNoLongerKnowsDoesNotHoldUpTheNew) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.close_errors = {StatusCode::NOT_FOUND}; });
  participant_->BeginFragment();
  while (participant_->fragments()[0].state != ParticipantState::kClosed) std::this_thread::yield();
  Queue(0);
  Queue(1);
  ExpectIdle();
  EXPECT_THAT(UploadedNumbers(kSecond), ElementsAre(0, 1));
  EXPECT_EQ(participant_->Close(kPatience, false).code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(server_.closed_sessions(), ElementsAre(kSecond));
  EXPECT_THAT(participant_->fragments()[0].stats.last_error, HasSubstr("NOT_FOUND"));
}

TEST_F(ParticipantFragmentsTest, AFragmentOfOneKeyframeIsNotToldOf) {
  OpenAligned();
  participant_->BeginFragment();
  Queue(0);
  ExpectIdle();
  EXPECT_EQ(server_.num_open_attempts(), 1) << "a view alone is not waited for";
  BeginFragmentOfTwo();
  ExpectIdle();
  EXPECT_EQ(server_.num_open_attempts(), 2);
  const std::vector<ParticipantFragment> fragments = participant_->fragments();
  ASSERT_THAT(fragments, SizeIs(3));
  EXPECT_EQ(fragments[1].session, std::nullopt);
  EXPECT_EQ(fragments[1].state, ParticipantState::kClosed);
  EXPECT_EQ(fragments[1].stats.num_skipped, 1U);
  EXPECT_EQ(participant_->stats().num_keyframes, 4U);
  EXPECT_EQ(participant_->stats().num_uploaded, 3U);
}

TEST_F(ParticipantFragmentsTest, ManyRestartsInARowLeaveAllFragmentsOnTheServer) {
  constexpr size_t kNumRestarts = 40;  // more than are followed
  OpenAligned();
  for (size_t i = 0; i < kNumRestarts; ++i) {
    BeginFragmentOfTwo();
    ExpectIdle();
  }
  ASSERT_TRUE(participant_->Close(kPatience, false).ok());
  EXPECT_THAT(server_.closed_sessions(), SizeIs(kNumRestarts + 1));
  const std::vector<ParticipantFragment> fragments = participant_->fragments();
  ASSERT_THAT(fragments, SizeIs(kNumRestarts + 1));
  for (size_t i = 0; i < fragments.size(); ++i) {
    EXPECT_EQ(fragments[i].session, SessionId(kFirst + i));
    EXPECT_EQ(fragments[i].state, ParticipantState::kClosed);
    EXPECT_TRUE(fragments[i].T_map_session.has_value());
  }
  EXPECT_EQ(participant_->stats().num_uploaded, 1 + 2 * kNumRestarts);
}

TEST_F(ParticipantFragmentsTest, ManyRestartsWithoutAServerKeepABoundedQueue) {
  constexpr size_t kNumRestarts = 40;
  OpenAligned();
  server_.Stop();
  for (size_t i = 0; i < kNumRestarts; ++i) BeginFragmentOfTwo();
  const ParticipantStats stats = participant_->stats();
  EXPECT_EQ(stats.num_keyframes, 1 + 2 * kNumRestarts);
  const std::vector<ParticipantFragment> fragments = participant_->fragments();
  ASSERT_THAT(fragments, SizeIs(kNumRestarts + 1));
  EXPECT_EQ(fragments[1].stats.num_dropped, 2U) << "the oldest is given up";
  EXPECT_EQ(fragments[kNumRestarts].stats.num_dropped, 0U);
  EXPECT_GE(stats.num_dropped, 40U);
}

TEST_F(ParticipantFragmentsTest, AfterClosingAFragmentTakesNothingAndHasNoPlace) {
  OpenAligned();
  ASSERT_TRUE(participant_->Close(kPatience, false).ok());
  BeginFragmentOfTwo();
  EXPECT_FALSE(participant_->T_map_session().has_value());
  EXPECT_EQ(participant_->stats().num_dropped, 2U);
  EXPECT_TRUE(participant_->Close(kPatience, false).ok());
  EXPECT_EQ(server_.num_open_attempts(), 1);
}

TEST_F(ParticipantFragmentsTest, ClosingWaitsForTheOptimisationsOfAllFragments) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.optimization_pending = true; });
  BeginFragmentOfTwo();
  EXPECT_EQ(participant_->Close(kShortWait, true).code(), absl::StatusCode::kDeadlineExceeded);
  v1::WatchSessionResponse optimized;
  optimized.mutable_optimized()->set_applied(true);
  server_.Send(optimized, kFirst);
  EXPECT_EQ(participant_->Close(kShortWait, true).code(), absl::StatusCode::kDeadlineExceeded);
  server_.Send(optimized, kSecond);
  EXPECT_TRUE(participant_->Close(kPatience, true).ok());
}

}  // namespace
}  // namespace mapp
