#include "mapp/client/participant.h"

#include "fake_map_service.h"
#include "mapp/codec/query_codec.h"
#include "synthetic_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace mapp {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;
using testing::SizeIs;

constexpr milliseconds kPatience{10'000};
constexpr milliseconds kShortWait{100};

/// Records what a SLAM system would have been given. Thread-safe.
class RecordingAdapter final : public SlamAdapter {
 public:
  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override {
    MutexLock lock(mutex_);
    maps_.push_back(std::move(map));
  }
  void LeaveSharedMap() override {
    MutexLock lock(mutex_);
    ++num_left_;
  }
  std::vector<std::shared_ptr<const SharedMap>> maps() const {
    MutexLock lock(mutex_);
    return maps_;
  }
  int num_left() const {
    MutexLock lock(mutex_);
    return num_left_;
  }

 private:
  mutable Mutex mutex_;
  std::vector<std::shared_ptr<const SharedMap>> maps_ ABSL_GUARDED_BY(mutex_);
  int num_left_ ABSL_GUARDED_BY(mutex_) = 0;
};

Pose3 At(double x) { return Pose3(Eigen::Quaterniond::Identity(), {x, 0, 0}); }

class ParticipantTest : public testing::Test {
 protected:
  ParticipantTest() {
    options_.map_name = "place";
    client_options_.server_address = server_.address();
    client_options_.first_backoff = milliseconds(1);
    client_options_.max_backoff = milliseconds(5);
    client_options_.retry_for = milliseconds(200);
  }

  void Open() {
    auto opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
    ASSERT_TRUE(opened.ok()) << opened.status();
    participant_ = *std::move(opened);
  }
  /// As founder: aligned by its first upload, which is keyframe 0.
  void OpenAligned() {
    server_.Change([](FakeMapService::Script& script) { script.T_map_session = TestAlignment(); });
    Open();
    HandIn(0);
  }
  /// Aligned, and on shared map number 1.
  void OpenSharing() {
    OpenAligned();
    server_.Change([](FakeMapService::Script& script) {
      script.samples_redundant = true;
      script.tiles = {TestTile(Revision(1))};
    });
    HandIn(1);
    ASSERT_EQ(participant_->state(), ParticipantState::kSharing);
  }
  void HandIn(uint32_t number) {
    participant_->OnKeyframe(TestKeyframe(number, At(0.1 * number)));
    const Status idle = participant_->WaitIdle(kPatience);
    ASSERT_TRUE(idle.ok()) << idle;
  }
  /// A frame on shared map `number`; a failed one brings a keyframe numbered 100.
  void Frame(uint32_t number, bool localized) {
    const SharedMapFrame frame{.shared_map_number = number,
                               .num_matches = localized ? 200 : 3,
                               .localized = localized,
                               .T_session_camera = {}};
    participant_->OnSharedMapFrame(frame, [this] {
      ++num_keyframes_asked_;
      return std::optional(TestKeyframe(100, At(0.2)));
    });
    const Status idle = participant_->WaitIdle(kPatience);
    ASSERT_TRUE(idle.ok()) << idle;
  }

  FakeMapService server_;
  RecordingAdapter adapter_;
  MapClientOptions client_options_;
  ParticipantOptions options_;
  int num_keyframes_asked_ = 0;
  std::unique_ptr<Participant> participant_;  // last: uses all of the above
};

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
  EXPECT_EQ(num_keyframes_asked_, 0);
}

// Algorithm 1 of the paper, path by path.

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

// Servers that are away or refuse.

TEST_F(ParticipantTest, UploadsAreTriedUntilAcknowledgedAndStoredOnce) {
  using grpc::StatusCode;
  server_.Change([](FakeMapService::Script& script) {
    script.T_map_session = TestAlignment();
    script.upload_errors = {StatusCode::UNAVAILABLE, StatusCode::DEADLINE_EXCEEDED, StatusCode::UNAVAILABLE};
  });
  Open();
  HandIn(0);
  EXPECT_EQ(server_.num_upload_attempts(), 4);
  EXPECT_THAT(server_.uploads(), SizeIs(1));
  EXPECT_EQ(participant_->stats().num_uploaded, 1U);
  EXPECT_EQ(participant_->stats().traffic.num_uploads, 1U);
  EXPECT_EQ(participant_->stats().traffic.num_retries, 3U);
}

TEST_F(ParticipantTest, ARefusedKeyframeIsCountedAndTheNextGoesOn) {
  server_.Change([](FakeMapService::Script& script) {
    script.T_map_session = TestAlignment();
    script.upload_errors = {grpc::StatusCode::INVALID_ARGUMENT};
  });
  Open();
  HandIn(0);
  HandIn(1);
  EXPECT_EQ(participant_->stats().num_rejected, 1U);
  EXPECT_THAT(participant_->stats().last_error, HasSubstr("INVALID_ARGUMENT"));
  ASSERT_THAT(server_.uploads(), SizeIs(1));
  EXPECT_EQ(server_.uploads()[0].number, 1U);
}

TEST_F(ParticipantTest, AMalformedKeyframeIsRefusedAtTheDoor) {
  Open();
  Keyframe malformed = TestKeyframe(0, At(0));
  malformed.features[3].point->depth_m = -1;
  participant_->OnKeyframe(malformed);
  EXPECT_EQ(participant_->stats().num_rejected, 1U);
  EXPECT_TRUE(participant_->WaitIdle(kPatience).ok());
  EXPECT_EQ(server_.num_upload_attempts(), 0);
}

TEST_F(ParticipantTest, AQueryThatTheServerCannotAnswerYetIsFollowedByTheWholeKeyframe) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) { script.query_errors = {grpc::StatusCode::FAILED_PRECONDITION}; });
  HandIn(1);
  ASSERT_THAT(server_.uploads(), SizeIs(2));
  EXPECT_FALSE(server_.uploads()[1].partial);
}

TEST_F(ParticipantTest, AFullQueueDropsTheOldest) {
  options_.max_queued_keyframes = 3;
  server_.Change([](FakeMapService::Script& script) { script.T_map_session = TestAlignment(); });
  Open();
  server_.Stop();
  for (uint32_t number = 0; number < 10; ++number) participant_->OnKeyframe(TestKeyframe(number, At(0)));
  const ParticipantStats stats = participant_->stats();
  EXPECT_EQ(stats.num_keyframes, 10U);
  EXPECT_GE(stats.num_dropped, 6U) << "three wait, and one may be under way";
  EXPECT_LE(stats.num_dropped, 7U);
  EXPECT_EQ(participant_->WaitIdle(kShortWait).code(), absl::StatusCode::kDeadlineExceeded);
}

TEST_F(ParticipantTest, OpeningWithoutAServerSaysWhichServer) {
  server_.Stop();
  const auto opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
  EXPECT_EQ(opened.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(opened.status().ToString(), HasSubstr(server_.address()));
}

// Policies and closing.

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
  EXPECT_NEAR(static_cast<double>(stats.traffic.upload_bytes), static_cast<double>(stats.full_bytes), 3 * 8);
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

TEST_F(ParticipantTest, OptionsAreCheckedByName) {
  options_.num_samples = 1001;
  auto opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
  EXPECT_THAT(opened.status().ToString(), HasSubstr("num_samples: "));
  options_.num_samples = 1000;
  opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, nullptr);
  EXPECT_THAT(opened.status().ToString(), HasSubstr("adapter: "));
}

}  // namespace
}  // namespace mapp
