// Servers that are away or refuse.

#include "participant_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

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

}  // namespace
}  // namespace mapp
