// What devices on shared maps report of its points: taken in, refused, summed up.

#include "mapp/codec/evidence_codec.h"
#include "server/changes/device_evidence.h"
#include "server/service/report_budget.h"
#include "tests/unit/server/views_fixture.h"

#include <gmock/gmock.h>

#include <chrono>

namespace mapp::testing {
namespace {

using std::chrono::steady_clock;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

class EvidenceTest : public ViewsTest {
 protected:
  EvidenceTest() : device_(Open()) { Align(device_); }

  std::unique_ptr<MapReader> Reader() { return *store_->Read(); }
  /// Of so many of the map's points, seen once and missed twice.
  std::vector<PointFinding> Findings(size_t num_points) {
    std::vector<PointFinding> findings;
    const StatusOr<std::vector<PointRecord>> points = Reader()->PointsOfSession(session_);
    for (const PointRecord& point : *points) {
      if (IsInEvidenceSample(point.id)) findings.push_back({point.id, 1, 2});
    }
    std::ranges::sort(findings, {}, &PointFinding::point);
    EXPECT_GT(findings.size(), num_points);
    findings.resize(num_points);
    return findings;
  }
  StatusOr<StoredEvidence> Report(const std::string& packet, uint32_t number = 0,
                                  std::optional<SessionId> session = {}) {
    return service_->ReportEvidence(context_, session.value_or(device_), number, packet);
  }
  Status Refusal(const std::string& packet, std::optional<SessionId> session = {}) {
    const Status status = Report(packet, 0, session).status();
    EXPECT_THAT(*Reader()->ListEvidence(session.value_or(device_)), IsEmpty()) << "nothing half-done";
    return status;
  }
  void Change(const std::function<void(SessionRecord&)>& change) {
    const Status changed = store_->Write(context_, [&](MapWriter& writer) -> Status {
      MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(device_));
      change(record);
      return writer.UpdateSession(record);
    });
    EXPECT_TRUE(changed.ok()) << changed;
  }

  SessionId device_;
};

/// The first point from an id on that devices tell of.
MapPointId SampledFrom(uint64_t id) {
  while (!IsInEvidenceSample(MapPointId(id))) ++id;
  return MapPointId(id);
}

std::string MessageOf(const Status& status) { return std::string(status.message()); }

TEST_F(EvidenceTest, IsStoredOnce) {
  const std::string packet = EncodeEvidence(Findings(50));
  const StatusOr<StoredEvidence> stored = Report(packet);
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_FALSE(stored->already_stored);
  EXPECT_EQ(stored->num_points, 50U);
  EXPECT_EQ(stored->num_unknown_points, 0U);
  const StatusOr<StoredEvidence> again = Report(packet);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->already_stored);
  ASSERT_TRUE(Report(packet, 7).ok());
  const std::vector<EvidenceRecord> evidence = *Reader()->ListEvidence(device_);
  ASSERT_THAT(evidence, SizeIs(2));
  EXPECT_EQ(evidence[0].packet, packet);
  EXPECT_GT(evidence[0].received_ns, 0);
  EXPECT_EQ(evidence[1].number, 7U);
}

TEST_F(EvidenceTest, ARepeatIsAnsweredAfterTheSessionHasClosed) {
  const std::string packet = EncodeEvidence(Findings(10));
  ASSERT_TRUE(Report(packet).ok());
  ASSERT_TRUE(service_->CloseSession(context_, device_).ok());
  EXPECT_TRUE(Report(packet)->already_stored);
  EXPECT_EQ(Report(packet, 1).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(EvidenceTest, PointsThatTheMapDoesNotHaveAreLeftOut) {
  std::vector<PointFinding> findings = Findings(10);
  findings.push_back({SampledFrom(1'000'000), 1, 0});
  findings.push_back({SampledFrom(2'000'000), 1, 0});
  const StatusOr<StoredEvidence> stored = Report(EncodeEvidence(findings));
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(stored->num_points, 10U);
  EXPECT_EQ(stored->num_unknown_points, 2U);
  EXPECT_EQ(*FindingsOfEvidence(*Reader(), device_), Findings(10));
}

TEST_F(EvidenceTest, ReportsOfNoPointOfTheMapAreRefused) {
  const Status unknown = Refusal(EncodeEvidence(std::vector<PointFinding>{{SampledFrom(1'000'000), 1, 0}}));
  EXPECT_EQ(unknown.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(MessageOf(unknown), AllOf(StartsWith("evidence: "), HasSubstr("map \"room\" has none of the 1 points"),
                                        HasSubstr("ask for the shared map again")));
  // Another map's points are no better than none.
  const std::string of_room = EncodeEvidence(Findings(10));
  device_ = Open(SensorKind::kRgbd, "elsewhere");
  Align(device_);
  EXPECT_EQ(Refusal(of_room).code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(EvidenceTest, BrokenPacketsAreRefused) {
  const std::string good = EncodeEvidence(Findings(10));
  const auto refuse = [&](const std::string& packet, const std::string& message) {
    const Status status = Refusal(packet);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(MessageOf(status), AllOf(StartsWith("evidence"), HasSubstr(message)));
  };
  refuse("", "truncated");
  refuse(EncodeEvidence({}), "no points");
  refuse(good.substr(0, good.size() - 1), "truncated");
  refuse(good + "x", "crc32c");
  refuse(std::string(kMaxEvidenceBytes + 1, 'x'), "at most");
  EXPECT_TRUE(Report(good).ok()) << "the session goes on";
}

TEST_F(EvidenceTest, SessionsThatMayNotReportAreToldWhy) {
  const std::string packet = EncodeEvidence(Findings(10));
  EXPECT_EQ(Refusal(packet, SessionId(4711)).code(), absl::StatusCode::kNotFound);
  const Status unaligned = Refusal(packet, Open());
  EXPECT_EQ(unaligned.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(MessageOf(unaligned), HasSubstr("not aligned with its map yet"));
  Change([](SessionRecord& record) {
    record.quarantine = Quarantine{.since_ns = 1, .reason = "its depths are wrong", .released_ns = std::nullopt};
  });
  const Status quarantined = Refusal(packet);
  EXPECT_EQ(quarantined.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(MessageOf(quarantined), HasSubstr("its depths are wrong"));
  Change([](SessionRecord& record) { record.quarantine->released_ns = 2; });
  EXPECT_TRUE(Report(packet).ok());
  ASSERT_TRUE(service_->CloseSession(context_, device_).ok());
  const Status closed = Report(packet, 1).status();
  EXPECT_EQ(closed.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(MessageOf(closed), HasSubstr("is closed"));
}

TEST_F(EvidenceTest, AFloodIsHeldBackAndHarmsNobodyElse) {
  const std::string packet = EncodeEvidence(Findings(5));
  uint32_t number = 0;
  Status refused;
  while (refused.ok() && number < 1000) refused = Report(packet, number++).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(MessageOf(refused), HasSubstr("try again in"));
  EXPECT_GE(number, 30U);
  EXPECT_LT(number, 40U);
  EXPECT_THAT(*Reader()->ListEvidence(device_), SizeIs(number - 1));
  EXPECT_TRUE(Report(packet, 0)->already_stored) << "repeats cost nothing";
  const SessionId other = Open();
  Align(other);
  EXPECT_TRUE(Report(packet, 0, other).ok());
}

TEST_F(EvidenceTest, ReportsOfASessionAddUp) {
  const std::vector<PointFinding> all = Findings(20);
  ASSERT_TRUE(Report(EncodeEvidence(std::span(all).first(15)), 0).ok());
  ASSERT_TRUE(Report(EncodeEvidence(std::span(all).last(15)), 1).ok());
  const std::vector<PointFinding> sums = *FindingsOfEvidence(*Reader(), device_);
  ASSERT_THAT(sums, SizeIs(20));
  for (size_t i = 0; i < sums.size(); ++i) {
    const uint16_t times = i >= 5 && i < 15 ? 2 : 1;
    EXPECT_EQ(sums[i], (PointFinding{all[i].point, times, static_cast<uint16_t>(2 * times)}));
  }
  EXPECT_THAT(*FindingsOfEvidence(*Reader(), session_), IsEmpty());
}

TEST_F(EvidenceTest, DamagedEvidenceIsNamed) {
  const auto append = [&](MapWriter& writer) {
    return writer.AppendEvidence({.session = device_, .number = 3, .received_ns = 0, .packet = "damaged"});
  };
  ASSERT_TRUE(store_->Write(context_, append).ok());
  const Status damaged = FindingsOfEvidence(*Reader(), device_).status();
  EXPECT_EQ(damaged.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(MessageOf(damaged), HasSubstr("evidence 3 of session"));
  EXPECT_EQ(service_->DetectChanges(context_, {.map_name = "room"}, {}).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(EvidenceTest, ASessionWithoutKeyframesTellsByItsReports) {
  const auto num_sessions = [&] {
    const StatusOr<DetectedChanges> detected = service_->DetectChanges(context_, {.map_name = "room"}, {});
    EXPECT_TRUE(detected.ok()) << detected.status();
    return detected->num_sessions;
  };
  EXPECT_EQ(num_sessions(), 1U);
  ASSERT_TRUE(Report(EncodeEvidence(Findings(50))).ok());
  EXPECT_EQ(num_sessions(), 2U);
  // Reports may follow: what is kept of a session's views does not hold them.
  EXPECT_FALSE(Reader()->FindFindings(device_)->has_value());
  Change([](SessionRecord& record) {
    record.quarantine = Quarantine{.since_ns = 1, .reason = "wrong", .released_ns = std::nullopt};
  });
  EXPECT_EQ(num_sessions(), 1U) << "nobody believes it any more";
}

class ReportBudgetTest : public ::testing::Test {
 protected:
  Status Take(size_t num_points, SessionId session = SessionId(1)) { return budget_.Take(session, num_points); }

  steady_clock::time_point now_;
  ReportBudget budget_{{.reports_per_minute = 6,
                        .max_reports_at_once = 2,
                        .points_per_minute = 600,
                        .max_points_at_once = 1000,
                        .now = [this] { return now_; }}};
};

TEST_F(ReportBudgetTest, FillsAgainWithTime) {
  EXPECT_TRUE(Take(1).ok());
  EXPECT_TRUE(Take(1).ok());
  const Status refused = Take(1);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(MessageOf(refused), HasSubstr("try again in 10 s"));
  now_ += std::chrono::seconds(9);
  EXPECT_FALSE(Take(1).ok());
  now_ += std::chrono::seconds(2);
  EXPECT_TRUE(Take(1).ok()) << "a refusal costs nothing";
  EXPECT_FALSE(Take(1).ok());
  now_ += std::chrono::hours(1);
  EXPECT_TRUE(Take(1).ok());
  EXPECT_TRUE(Take(1).ok());
  EXPECT_FALSE(Take(1).ok()) << "no more than so many at once, however long it was silent";
}

TEST_F(ReportBudgetTest, PointsCountForThemselves) {
  EXPECT_TRUE(Take(900).ok());
  EXPECT_THAT(MessageOf(Take(200)), HasSubstr("try again in 10 s"));
  EXPECT_TRUE(Take(200, SessionId(2)).ok());
  now_ += std::chrono::seconds(10);
  EXPECT_TRUE(Take(200).ok());
}

TEST_F(ReportBudgetTest, MemoryOfManySessionsIsBounded) {
  for (uint64_t session = 1; session <= 20'000; ++session) {
    EXPECT_TRUE(Take(1, SessionId(session)).ok());
    now_ += std::chrono::milliseconds(100);
  }
  EXPECT_TRUE(Take(1, SessionId(1)).ok());
}

}  // namespace
}  // namespace mapp::testing
