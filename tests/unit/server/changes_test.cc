// A cabinet is carried out of a room: what the service makes of the visits before and after.

#include "mapp/codec/evidence_codec.h"
#include "server/changes/change_scan.h"
#include "storage/map_store.h"
#include "tests/unit/server/quarantine_fixture.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <tuple>

namespace mapp::testing {
namespace {

using ::testing::HasSubstr;

/// Where SyntheticWorld's cabinet stands, in the founder's frame, which is the map's.
const OrientedBox kCabinet{Pose3(Eigen::Quaterniond::Identity(), {0, 0.6, 2.8}), {1.4, 1.8, 0.6}};

class ChangesTest : public QuarantineTest {
 protected:
  void Visit(const SyntheticWorld& world) {
    const SessionId session = OpenAligned(world);
    const Status walked = WalkOn(session, Round(kFounderViews, 0.1), 5, {}, world);
    EXPECT_TRUE(walked.ok()) << walked;
    EXPECT_TRUE(service_->CloseSession(context_, session).ok());
    // What is optimized after a visit moves frames, which what comes next is compared with.
    service_->WaitUntilIdle();
  }
  DetectedChanges Detect(double auto_accept = 0) {
    const auto detected = service_->DetectChanges(context_, {.map_name = "room", .auto_accept = auto_accept}, {});
    EXPECT_TRUE(detected.ok()) << detected.status();
    return detected.ok() ? *detected : DetectedChanges{};
  }
  ChangeId FindCabinet() {
    const DetectedChanges detected = Detect();
    EXPECT_EQ(detected.changes.size(), 1U);
    return detected.changes.empty() ? ChangeId() : detected.changes.front().id;
  }
  std::vector<ChangeRecord> Stored() { return *service_->ListChanges(context_, "room"); }
  /// A visit of a device that uploads nothing, and says that it has missed everything where the cabinet stands.
  void MissCabinet(const std::string& device) {
    std::vector<PointFinding> missed;
    for (const auto& [id, point] : Content().points) {
      if (kCabinet.Contains(point.position, 0.05) && IsInEvidenceSample(id)) missed.push_back({id, 0, 3});
    }
    std::ranges::sort(missed, {}, &PointFinding::point);
    const auto tell = [&](MapWriter& writer) -> Status {
      SessionRecord session = writer.ListSessions(Map().id)->front();
      session.id = SessionId();
      session.device = device;
      session.opened_ns = 0;
      MAPP_ASSIGN_OR_RETURN(session.id, writer.InsertSession(session));
      MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
      return writer.AppendEvidence(
          {.session = session.id, .number = 0, .received_ns = 0, .packet = EncodeEvidence(missed)});
    };
    const Status told = store_->Write(context_, tell);
    ASSERT_TRUE(told.ok()) << told;
  }
  size_t NumLive(const std::vector<MapPointId>& points) { return (*store_->Read())->FindPoints(points)->size(); }
};

TEST_F(ChangesTest, NothingHasChangedWhereNothingHas) {
  Visit(world_);
  Visit(world_);
  Visit(world_);
  const DetectedChanges detected = Detect();
  EXPECT_TRUE(detected.changes.empty());
  EXPECT_EQ(detected.num_sessions, 4U);
}

TEST_F(ChangesTest, FindsWhatWasCarriedAwayAndReadsNothingTwice) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  const DetectedChanges detected = Detect();
  ASSERT_EQ(detected.changes.size(), 1U);
  const ChangeRecord& change = detected.changes.front();
  EXPECT_EQ(change.kind, ChangeKind::kVanished);
  EXPECT_EQ(change.status, ChangeStatus::kProposed);
  EXPECT_GT(change.confidence, 0.8);
  ASSERT_TRUE(change.box_before.has_value());
  EXPECT_TRUE(change.box_before->Contains(kCabinet.T_frame_box.translation()));
  EXPECT_GT(IntersectionOverUnion(*change.box_before, kCabinet), 0.2);  // its back was never seen
  EXPECT_GT(change.points_before.size(), 20U);
  EXPECT_EQ(change.sessions.size(), 3U);
  EXPECT_LT(change.after_ns, change.before_ns);
  EXPECT_EQ(detected.num_new, 1U);
  EXPECT_EQ(detected.num_sessions_read, 3U);

  const DetectedChanges again = Detect();
  ASSERT_EQ(again.changes.size(), 1U);
  EXPECT_EQ(again.changes.front().id, change.id);
  EXPECT_EQ(again.changes.front().points_before, change.points_before);
  EXPECT_EQ(again.num_new, 0U);
  EXPECT_EQ(again.num_sessions_read, 0U);
  Visit(world_.WithoutCabinet());
  EXPECT_EQ(Detect().num_sessions_read, 1U);
}

TEST_F(ChangesTest, WhatComesBackHasComeBack) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  Visit(world_.WithoutCabinet());
  Visit(world_);
  Visit(world_);
  std::vector<ChangeKind> kinds;
  for (const ChangeRecord& change : Detect().changes) kinds.push_back(change.kind);
  EXPECT_THAT(kinds, ::testing::ElementsAre(ChangeKind::kVanished, ChangeKind::kAppeared));
}

TEST_F(ChangesTest, WhatIsRememberedOfEarlierScansChangesNothing) {
  const auto scan = [&](ThingMemory& memory) {
    const auto found = ScanForChanges(context_, *store_, "room", {}, memory, {});
    EXPECT_TRUE(found.ok()) << found.status();
    std::vector<std::tuple<ChangeKind, double, int64_t, int64_t, int64_t, int64_t, std::vector<SessionId>,
                           std::vector<MapPointId>, std::vector<MapPointId>>>
        told;
    if (!found.ok()) return told;
    for (const ChangeRecord& change : found->changes) {
      told.emplace_back(change.kind, change.confidence, change.after_ns, change.before_ns, change.first_seen_ns,
                        change.last_seen_ns, change.sessions, change.points_before, change.points_after);
    }
    return told;
  };
  ThingMemory memory;
  size_t most = 0;
  for (const bool has_cabinet : {true, false, false, true, true}) {
    Visit(has_cabinet ? world_ : world_.WithoutCabinet());
    ThingMemory none;
    const auto told = scan(memory);
    EXPECT_EQ(told, scan(none));
    EXPECT_EQ(told, scan(memory));  // all of it remembered
    most = std::max(most, told.size());
  }
  EXPECT_EQ(most, 2U);
}

TEST_F(ChangesTest, OneDevicesWordAloneRetiresNothing) {
  Visit(world_);
  Visit(world_);
  for (int i = 0; i < 5; ++i) MissCabinet("liar");
  EXPECT_TRUE(Detect().changes.empty());
  MissCabinet("another");
  const DetectedChanges detected = Detect();
  ASSERT_EQ(detected.changes.size(), 1U);
  EXPECT_EQ(detected.changes.front().kind, ChangeKind::kVanished);
  EXPECT_EQ(detected.num_sessions, 9U);
}

TEST_F(ChangesTest, AcceptanceEndsPointsAndUndoingBringsThemBack) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  const ChangeId id = FindCabinet();
  const MapContent before = Content();
  const auto accepted = service_->AcceptChanges(context_, "room", {&id, 1});
  ASSERT_TRUE(accepted.ok()) << accepted.status();
  ASSERT_EQ(accepted->changes.size(), 1U);
  const ChangeRecord& change = accepted->changes.front();
  EXPECT_EQ(change.status, ChangeStatus::kAccepted);
  EXPECT_EQ(change.applied, accepted->revision);
  EXPECT_EQ(accepted->num_points, change.points_before.size());
  EXPECT_EQ(NumLive(change.points_before), 0U);
  EXPECT_EQ(Map().num_points, static_cast<int64_t>(before.points.size() - change.points_before.size()));
  const auto revisions = (*store_->Read())->ListRevisions(Map().id, *change.applied, *change.applied);
  EXPECT_EQ(revisions->front().cause, RevisionCause::kChange);

  // Once more changes nothing, and what is gone is not found again.
  EXPECT_EQ(service_->AcceptChanges(context_, "room", {&id, 1})->num_points, 0U);
  EXPECT_EQ(Detect().num_new, 0U);
  ASSERT_EQ(Stored().size(), 1U);
  EXPECT_EQ(Stored().front().status, ChangeStatus::kAccepted);

  const auto undone = service_->UndoChanges(context_, "room", {&id, 1});
  ASSERT_TRUE(undone.ok()) << undone.status();
  EXPECT_EQ(undone->num_points, change.points_before.size());
  EXPECT_EQ(Stored().front().status, ChangeStatus::kProposed);
  EXPECT_FALSE(Stored().front().applied.has_value());
  ExpectSame(before, Content(), /*some_observers=*/false);
  EXPECT_EQ(FindCabinet(), id);
}

TEST_F(ChangesTest, WhatIsRejectedIsNotProposedAgain) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  const ChangeId id = FindCabinet();
  ASSERT_TRUE(service_->RejectChanges(context_, "room", {&id, 1}).ok());
  const DetectedChanges detected = Detect(/*auto_accept=*/0.5);
  EXPECT_EQ(detected.num_new, 0U);
  EXPECT_EQ(detected.num_accepted, 0U);
  ASSERT_EQ(Stored().size(), 1U);
  EXPECT_EQ(Stored().front().status, ChangeStatus::kRejected);
  const auto accepted = service_->AcceptChanges(context_, "room", {&id, 1});
  EXPECT_TRUE(absl::IsFailedPrecondition(accepted.status()));
  EXPECT_THAT(std::string(accepted.status().message()), HasSubstr("is rejected; undo that first"));
  ASSERT_TRUE(service_->UndoChanges(context_, "room", {&id, 1}).ok());
  EXPECT_EQ(Detect(/*auto_accept=*/0.5).num_accepted, 1U);
  EXPECT_EQ(Stored().front().status, ChangeStatus::kAccepted);
  EXPECT_TRUE(absl::IsFailedPrecondition(service_->RejectChanges(context_, "room", {&id, 1}).status()));
}

TEST_F(ChangesTest, OneDecisionIsTakenWholeOrNotAtAll) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  const ChangeId id = FindCabinet();
  const ChangeId ids[] = {id, ChangeId(4711)};
  const auto accepted = service_->AcceptChanges(context_, "room", ids);
  EXPECT_TRUE(absl::IsNotFound(accepted.status()));
  EXPECT_THAT(std::string(accepted.status().message()), HasSubstr("has no change 4711"));
  EXPECT_EQ(Stored().front().status, ChangeStatus::kProposed);
  EXPECT_EQ(NumLive(Stored().front().points_before), Stored().front().points_before.size());
}

TEST_F(ChangesTest, WhatIsCompactedAwayCannotBeUndone) {
  Visit(world_);
  Visit(world_.WithoutCabinet());
  const ChangeId id = FindCabinet();
  ASSERT_TRUE(service_->AcceptChanges(context_, "room", {&id, 1}).ok());
  const CompactionRequest all{.map_name = "room", .keep_revisions = 0, .keep_days = {}, .dry_run = false};
  ASSERT_TRUE(service_->CompactMap(context_, all, {}).ok());
  EXPECT_TRUE(absl::IsOutOfRange(service_->UndoChanges(context_, "room", {&id, 1}).status()));
  EXPECT_EQ(Stored().front().status, ChangeStatus::kAccepted);
}

TEST_F(ChangesTest, BadSearchesSayWhatIsWrong) {
  const auto search = [&](const ChangeSearch& wanted) {
    return service_->DetectChanges(context_, wanted, {}).status();
  };
  EXPECT_TRUE(absl::IsNotFound(search({.map_name = "attic"})));
  EXPECT_TRUE(absl::IsInvalidArgument(search({.map_name = "room", .from_ns = 2, .to_ns = 1})));
  EXPECT_TRUE(absl::IsInvalidArgument(search({.map_name = "room", .auto_accept = 1.5})));
  const Status too_early = search({.map_name = "room", .to_ns = 1'000'000'000});
  EXPECT_TRUE(absl::IsFailedPrecondition(too_early));
  EXPECT_THAT(std::string(too_early.message()), HasSubstr("no session was opened until 1970-01-01T00:00:01Z"));
}

}  // namespace
}  // namespace mapp::testing
