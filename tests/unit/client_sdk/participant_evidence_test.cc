// What a device tells of the points of the shared maps it localises on.

#include "evidence_views.h"
#include "mapp/codec/evidence_codec.h"
#include "participant_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class ParticipantEvidenceTest : public ParticipantTest {
 protected:
  void OpenOnMap() {
    OpenAligned();
    server_.Change([&](FakeMapService::Script& script) {
      script.samples_redundant = true;
      script.tiles = {tile_};
    });
    HandIn(1);
    ASSERT_EQ(participant_->state(), ParticipantState::kSharing);
  }
  void Localize(double x_m, uint32_t map_number = 1) {
    const SharedMapFrame frame{
        .shared_map_number = map_number, .num_matches = 200, .localized = true, .T_session_camera = At(x_m)};
    participant_->OnSharedMapFrame(frame, [&] {
      ++num_keyframes_asked_;
      return std::optional(ViewOf(tile_, 1'000'000'000));
    });
    const Status idle = participant_->WaitIdle(kPatience);
    ASSERT_TRUE(idle.ok()) << idle;
  }
  void FailForGood() {
    server_.Change([](FakeMapService::Script& script) { script.shared_map_errors = {grpc::StatusCode::NOT_FOUND}; });
    Frame(1, false);
    ASSERT_EQ(participant_->state(), ParticipantState::kExpanding);
  }
  Status Close() { return participant_->Close(kPatience, /*wait_for_optimization=*/false); }

  const Tile tile_ = JudgedTile(Revision(1));
};

TEST_F(ParticipantEvidenceTest, IsReportedBeforeTheSessionCloses) {
  OpenOnMap();
  Localize(0);
  EXPECT_THAT(server_.evidence(), IsEmpty()) << "not before a minute is over";
  ASSERT_TRUE(Close().ok());
  ASSERT_THAT(server_.evidence(), SizeIs(1));
  const v1::ReportEvidenceRequest report = server_.evidence()[0];
  EXPECT_EQ(report.session_id(), FakeMapService::kSession);
  EXPECT_EQ(report.number(), 0U);
  const StatusOr<std::vector<PointFinding>> findings = DecodeEvidence(report.evidence());
  ASSERT_TRUE(findings.ok()) << findings.status();
  EXPECT_GT(findings->size(), 30U);
  for (const PointFinding& finding : *findings) EXPECT_EQ(finding.num_missed, 0U);
  const TrafficCounters traffic = participant_->stats().traffic;
  EXPECT_EQ(traffic.num_evidence_reports, 1U);
  EXPECT_EQ(traffic.evidence_bytes, report.ByteSizeLong());
}

TEST_F(ParticipantEvidenceTest, IsReportedWhereTheDeviceLeavesTheMap) {
  OpenOnMap();
  Localize(0);
  FailForGood();
  EXPECT_THAT(server_.evidence(), SizeIs(1));
  ASSERT_TRUE(Close().ok());
  EXPECT_THAT(server_.evidence(), SizeIs(1)) << "nothing new";
}

TEST_F(ParticipantEvidenceTest, AViewIsTakenOnceAMetre) {
  OpenOnMap();
  for (int i = 0; i <= 10; ++i) Localize(0.25 * i);
  EXPECT_EQ(num_keyframes_asked_, 3);
  Localize(10, /*map_number=*/7);
  EXPECT_EQ(num_keyframes_asked_, 3) << "of a map that it no longer uses";
}

TEST_F(ParticipantEvidenceTest, SwitchedOffNothingIsAskedOrSent) {
  options_.report_evidence = false;
  OpenOnMap();
  Localize(0);
  ASSERT_TRUE(Close().ok());
  EXPECT_EQ(num_keyframes_asked_, 0);
  EXPECT_EQ(server_.num_evidence_attempts(), 0);
}

TEST_F(ParticipantEvidenceTest, WhatAServerThatWasAwayMissedComesLater) {
  OpenOnMap();
  Localize(0);
  server_.Change([](FakeMapService::Script& script) { script.evidence_errors = {grpc::StatusCode::UNAVAILABLE}; });
  FailForGood();
  EXPECT_THAT(server_.evidence(), IsEmpty());
  EXPECT_EQ(server_.num_evidence_attempts(), 1) << "while the device maps on";
  server_.Change([](FakeMapService::Script& script) {
    script.evidence_errors = {grpc::StatusCode::UNAVAILABLE, grpc::StatusCode::DEADLINE_EXCEEDED};
  });
  ASSERT_TRUE(Close().ok());
  EXPECT_THAT(server_.evidence(), SizeIs(1));
  EXPECT_EQ(server_.num_evidence_attempts(), 4);
  EXPECT_THAT(server_.closed_sessions(), SizeIs(1));
}

TEST_F(ParticipantEvidenceTest, WhatIsRefusedIsDroppedAndTheSessionCloses) {
  for (const grpc::StatusCode code :
       {grpc::StatusCode::FAILED_PRECONDITION, grpc::StatusCode::RESOURCE_EXHAUSTED, grpc::StatusCode::UNIMPLEMENTED}) {
    OpenOnMap();
    Localize(0);
    server_.Change([&](FakeMapService::Script& script) { script.evidence_errors = {code}; });
    ASSERT_TRUE(Close().ok());
    EXPECT_THAT(server_.evidence(), IsEmpty());
    EXPECT_THAT(participant_->stats().last_error, HasSubstr("as the test wants it"));
    EXPECT_EQ(participant_->state(), ParticipantState::kClosed);
    participant_.reset();
  }
}

}  // namespace
}  // namespace mapp
