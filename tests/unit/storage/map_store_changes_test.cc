// Evidence, findings and changes of the world, on every engine.
#include "tests/unit/storage/store_fixture.h"

#include <limits>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

std::vector<uint32_t> NumbersOf(const std::vector<EvidenceRecord>& evidence) {
  std::vector<uint32_t> numbers;
  for (const EvidenceRecord& record : evidence) numbers.push_back(record.number);
  return numbers;
}

class MapStoreChangesTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
    garage_ = NewScene("garage");
    MustWrite(
        [&](MapWriter& writer) { other_ = Value(writer.InsertSession(Value(writer.GetSession(scene_.session)))); });
  }

  Status Append(SessionId session, uint32_t number, const std::string& packet, int64_t received_ns = 5) {
    return Write([&](MapWriter& writer) {
      return writer.AppendEvidence(
          {.session = session, .number = number, .received_ns = received_ns, .packet = packet});
    });
  }
  StatusOr<ChangeId> Put(const ChangeRecord& change) {
    ChangeId id;
    MAPP_RETURN_IF_ERROR(Write([&](MapWriter& writer) -> Status {
      MAPP_ASSIGN_OR_RETURN(id, writer.PutChange(change));
      return absl::OkStatus();
    }));
    return id;
  }
  Status Delete(ChangeId change) {
    return Write([&](MapWriter& writer) { return writer.DeleteChange(change); });
  }
  /// One with something in every field.
  ChangeRecord Moved() const {
    ChangeRecord change;
    change.map = scene_.map;
    change.kind = ChangeKind::kMoved;
    change.status = ChangeStatus::kAccepted;
    change.confidence = 0.75;
    change.after_ns = 100;
    change.before_ns = 200;
    change.first_seen_ns = 50;
    change.last_seen_ns = 150;
    change.sessions = {scene_.session, other_};
    change.box_before = OrientedBox{.T_frame_box = PoseAt(1, 2, 3), .size_m = {0.1, 0.2, 0.3}};
    change.box_after = OrientedBox{.T_frame_box = PoseAt(4, 5, 6), .size_m = {0.4, 0.5, 0.6}};
    change.points_before = {MapPointId(7), MapPointId(8), MapPointId(1000)};
    change.points_after = {MapPointId(9)};
    change.detected = Revision(3);
    change.applied = Revision(4);
    return change;
  }
  static void ExpectSameBox(const std::optional<OrientedBox>& box, const std::optional<OrientedBox>& expected) {
    ASSERT_EQ(box.has_value(), expected.has_value());
    if (!box) return;
    EXPECT_EQ(box->size_m, expected->size_m);
    EXPECT_EQ(box->T_frame_box.translation(), expected->T_frame_box.translation());
    EXPECT_EQ(box->T_frame_box.rotation().coeffs(), expected->T_frame_box.rotation().coeffs());
  }
  static void ExpectSame(const ChangeRecord& change, const ChangeRecord& expected) {
    EXPECT_EQ(change.map, expected.map);
    EXPECT_EQ(change.kind, expected.kind);
    EXPECT_EQ(change.status, expected.status);
    EXPECT_EQ(change.confidence, expected.confidence);
    EXPECT_EQ(change.after_ns, expected.after_ns);
    EXPECT_EQ(change.before_ns, expected.before_ns);
    EXPECT_EQ(change.first_seen_ns, expected.first_seen_ns);
    EXPECT_EQ(change.last_seen_ns, expected.last_seen_ns);
    EXPECT_EQ(change.sessions, expected.sessions);
    ExpectSameBox(change.box_before, expected.box_before);
    ExpectSameBox(change.box_after, expected.box_after);
    EXPECT_EQ(change.points_before, expected.points_before);
    EXPECT_EQ(change.points_after, expected.points_after);
    EXPECT_EQ(change.detected, expected.detected);
    EXPECT_EQ(change.applied, expected.applied);
  }

  Scene scene_, garage_;
  SessionId other_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreChangesTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreChangesTest, EvidenceIsListedByNumber) {
  const std::string packet = TestBytes(1, 5000);
  Check(Append(scene_.session, 2, "second"));
  Check(Append(scene_.session, UINT32_MAX, ""));
  Check(Append(scene_.session, 0, packet, /*received_ns=*/0));
  Check(Append(other_, 1, "another's"));
  Reopen();
  const auto reader = Read();
  const std::vector<EvidenceRecord> evidence = Value(reader->ListEvidence(scene_.session));
  ASSERT_THAT(NumbersOf(evidence), ElementsAre(0, 2, UINT32_MAX));
  EXPECT_EQ(evidence[0].packet, packet);
  EXPECT_EQ(evidence[0].session, scene_.session);
  EXPECT_GT(evidence[0].received_ns, 0) << "the store's time";
  EXPECT_EQ(evidence[1].received_ns, 5);
  EXPECT_TRUE(Value(reader->HasEvidence(other_, 1)));
  EXPECT_FALSE(Value(reader->HasEvidence(other_, 2)));
  EXPECT_FALSE(Value(reader->HasEvidence(SessionId(77), 1)));
  EXPECT_THAT(Value(reader->ListEvidence(SessionId(77))), IsEmpty());
  EXPECT_EQ(Value(reader->GetMap(scene_.map)).revision, Revision(0)) << "it makes no revision";
}

TEST_P(MapStoreChangesTest, EvidenceIsStoredOnce) {
  Check(Append(scene_.session, 0, "first"));
  EXPECT_THAT(Append(scene_.session, 0, "again"), HasCode(StatusCode::kAlreadyExists));
  EXPECT_THAT(Append(SessionId(77), 0, "of nobody"), HasCode(StatusCode::kNotFound));
  const std::vector<EvidenceRecord> evidence = Value(Read()->ListEvidence(scene_.session));
  ASSERT_THAT(evidence, SizeIs(1));
  EXPECT_EQ(evidence[0].packet, "first");
}

TEST_P(MapStoreChangesTest, FindingsAreReplacedAndDropped) {
  const auto put = [&](SessionId session, const std::string& findings) {
    return Write([&](MapWriter& writer) { return writer.PutFindings(session, findings); });
  };
  Check(put(scene_.session, "first"));
  Check(put(scene_.session, "second"));
  Check(put(other_, ""));
  Check(put(garage_.session, "elsewhere"));
  EXPECT_THAT(put(SessionId(77), "of nobody"), HasCode(StatusCode::kNotFound));
  Reopen();
  EXPECT_EQ(Value(Read()->FindFindings(scene_.session)), "second");
  EXPECT_EQ(Value(Read()->FindFindings(other_)), "");
  EXPECT_EQ(Value(Read()->FindFindings(SessionId(77))), std::nullopt);
  Check(Write([&](MapWriter& writer) { return writer.DropFindings(scene_.map); }));
  EXPECT_EQ(Value(Read()->FindFindings(scene_.session)), std::nullopt);
  EXPECT_EQ(Value(Read()->FindFindings(other_)), std::nullopt);
  EXPECT_EQ(Value(Read()->FindFindings(garage_.session)), "elsewhere");
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.DropFindings(MapId(77)); }), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreChangesTest, ChangesKeepAllOfTheirFields) {
  ChangeRecord vanished = Moved();
  vanished.kind = ChangeKind::kVanished;
  vanished.box_after.reset();
  vanished.points_after.clear();
  vanished.applied.reset();
  ChangeRecord appeared = Moved();
  appeared.kind = ChangeKind::kAppeared;
  appeared.status = ChangeStatus::kRejected;
  appeared.box_before.reset();
  const ChangeId first = Value(Put(Moved()));
  const ChangeId second = Value(Put(vanished));
  const ChangeId third = Value(Put(appeared));
  Reopen();
  const std::vector<ChangeRecord> changes = Value(Read()->ListChanges(scene_.map));
  ASSERT_THAT(changes, SizeIs(3));
  EXPECT_EQ(changes[0].id, first);
  EXPECT_EQ(changes[1].id, second);
  EXPECT_EQ(changes[2].id, third);
  ExpectSame(changes[0], Moved());
  ExpectSame(changes[1], vanished);
  ExpectSame(changes[2], appeared);
  ExpectSame(Value(Read()->GetChange(second)), vanished);
  EXPECT_THAT(Value(Read()->ListChanges(garage_.map)), IsEmpty());
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(0)) << "they make no revision";
}

TEST_P(MapStoreChangesTest, ChangesAreReplacedAndDeleted) {
  ChangeRecord change = Moved();
  change.id = Value(Put(change));
  change.status = ChangeStatus::kRejected;
  change.applied.reset();
  change.points_after = {MapPointId(70)};
  EXPECT_EQ(Value(Put(change)), change.id);
  ExpectSame(Value(Read()->GetChange(change.id)), change);
  EXPECT_THAT(Value(Read()->ListChanges(scene_.map)), SizeIs(1));
  Check(Delete(change.id));
  EXPECT_THAT(Value(Read()->ListChanges(scene_.map)), IsEmpty());
  EXPECT_THAT(Delete(change.id), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Put(change), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(std::string(Read()->GetChange(change.id).status().message()),
              HasSubstr(std::to_string(change.id.value())));
  Reopen();
  EXPECT_GT(Value(Put(Moved())), change.id) << "no id is given twice";
}

TEST_P(MapStoreChangesTest, RefusesWhatCannotBe) {
  struct Case {
    std::string field;
    std::function<void(ChangeRecord&)> spoil;
    StatusCode code = StatusCode::kInvalidArgument;
  };
  const ChangeId stored = Value(Put(Moved()));
  const std::vector<Case> cases = {
      {"change.kind", [](ChangeRecord& c) { c.kind = static_cast<ChangeKind>(4); }},
      {"change.status", [](ChangeRecord& c) { c.status = static_cast<ChangeStatus>(0); }},
      {"change.confidence", [](ChangeRecord& c) { c.confidence = 1.01; }},
      {"change.confidence", [](ChangeRecord& c) { c.confidence = kNoNumber; }},
      {"change.after_ns", [](ChangeRecord& c) { c.after_ns = c.before_ns + 1; }},
      {"change.first_seen_ns", [](ChangeRecord& c) { c.first_seen_ns = c.last_seen_ns + 1; }},
      {"change.box_before", [](ChangeRecord& c) { c.box_before.reset(); }},
      {"change.box_after", [](ChangeRecord& c) { c.box_after.reset(); }},
      {"change.box_before", [](ChangeRecord& c) { c.box_before->size_m.y() = 0; }},
      {"change.box_after", [](ChangeRecord& c) { c.box_after->T_frame_box = PoseAt(kNoNumber, 0, 0); }},
      {"change.sessions", [](ChangeRecord& c) { std::swap(c.sessions[0], c.sessions[1]); }},
      {"change.points_before", [](ChangeRecord& c) { c.points_before[1] = c.points_before[0]; }},
      {"change.points_after", [](ChangeRecord& c) { c.points_after = {MapPointId(0)}; }},
      {"change.sessions", [&](ChangeRecord& c) { c.sessions = {garage_.session}; }},
      {"change.map",
       [&](ChangeRecord& c) {
         c.id = stored;
         c.map = garage_.map;
         c.sessions.clear();
       }},
      {"map 77", [](ChangeRecord& c) { c.map = MapId(77); }, StatusCode::kNotFound},
      {"session 77", [](ChangeRecord& c) { c.sessions = {SessionId(77)}; }, StatusCode::kNotFound},
      {"change 77", [](ChangeRecord& c) { c.id = ChangeId(77); }, StatusCode::kNotFound},
  };
  for (const Case& refused : cases) {
    ChangeRecord change = Moved();
    refused.spoil(change);
    const Status status = Put(change).status();
    EXPECT_THAT(status, HasCode(refused.code)) << refused.field;
    EXPECT_THAT(std::string(status.message()), HasSubstr(refused.field));
  }
  EXPECT_THAT(Value(Read()->ListChanges(scene_.map)), SizeIs(1));
}

TEST_P(MapStoreChangesTest, TheirMapTakesThemAlong) {
  Check(Append(scene_.session, 0, "packet"));
  Check(Append(garage_.session, 0, "packet"));
  const ChangeId change = Value(Put(Moved()));
  MustWrite([&](MapWriter& writer) {
    Check(writer.PutFindings(scene_.session, "findings"));
    Check(writer.DeleteMap(scene_.map));
  });
  const auto reader = Read();
  EXPECT_THAT(Value(reader->ListEvidence(scene_.session)), IsEmpty());
  EXPECT_EQ(Value(reader->FindFindings(scene_.session)), std::nullopt);
  EXPECT_THAT(reader->GetChange(change), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->ListChanges(scene_.map), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Value(reader->ListEvidence(garage_.session)), SizeIs(1));
}

TEST_P(MapStoreChangesTest, AnErasedSessionLeavesTheChangesOfOthers) {
  Check(Append(scene_.session, 0, "kept"));
  Check(Append(other_, 0, "erased"));
  ChangeRecord alone = Moved();
  alone.sessions = {other_};
  ChangeRecord without = Moved();
  without.sessions = {scene_.session};
  const ChangeId both = Value(Put(Moved()));
  const ChangeId of_the_erased = Value(Put(alone));
  const ChangeId of_the_other = Value(Put(without));
  MustWrite([&](MapWriter& writer) {
    Check(writer.PutFindings(scene_.session, "may show it"));
    Check(writer.PutFindings(other_, "shows it"));
    Check(writer.EraseSession(other_));
  });
  const auto reader = Read();
  EXPECT_THAT(Value(reader->ListEvidence(other_)), IsEmpty());
  EXPECT_THAT(Value(reader->ListEvidence(scene_.session)), SizeIs(1));
  EXPECT_EQ(Value(reader->FindFindings(other_)), std::nullopt);
  EXPECT_EQ(Value(reader->FindFindings(scene_.session)), std::nullopt);
  EXPECT_THAT(reader->GetChange(of_the_erased), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Value(reader->GetChange(both)).sessions, ElementsAre(scene_.session));
  ExpectSame(Value(reader->GetChange(of_the_other)), without);
}

TEST_P(MapStoreChangesTest, ReadersOfThePastSeeThemAsTheyAreNow) {
  Check(Append(garage_.session, 0, "elsewhere"));
  SessionId late;
  MustWrite([&](MapWriter& writer) { Value(writer.NextRevision(scene_.map)); });
  MustWrite([&](MapWriter& writer) {
    Value(writer.NextRevision(scene_.map));
    late = Value(writer.InsertSession(Value(writer.GetSession(scene_.session))));
  });
  Check(Append(late, 0, "packet"));
  MustWrite([&](MapWriter& writer) { Check(writer.PutFindings(late, "findings")); });
  const ChangeId change = Value(Put(Moved()));
  const auto past = Value(store().ReadAsOf(scene_.map, Revision(1)));
  EXPECT_THAT(past->GetSession(late), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Value(past->ListEvidence(late)), SizeIs(1));
  EXPECT_TRUE(Value(past->HasEvidence(late, 0)));
  EXPECT_EQ(Value(past->FindFindings(late)), "findings");
  EXPECT_THAT(Value(past->ListChanges(scene_.map)), SizeIs(1));
  EXPECT_TRUE(past->GetChange(change).ok());
  EXPECT_THAT(Value(past->ListEvidence(garage_.session)), IsEmpty()) << "other maps do not exist for it";
}

TEST_P(MapStoreChangesTest, AChangeThatFailsLeavesNothing) {
  EXPECT_THAT(Write([&](MapWriter& writer) -> Status {
                Check(writer.AppendEvidence({.session = other_, .number = 0, .received_ns = 0, .packet = "p"}));
                Check(writer.PutFindings(other_, "f"));
                Value(writer.PutChange(Moved()));
                EXPECT_THAT(Value(writer.ListChanges(scene_.map)), SizeIs(1)) << "reads see what is written";
                EXPECT_TRUE(Value(writer.HasEvidence(other_, 0)));
                return absl::AbortedError("changed my mind");
              }),
              HasCode(StatusCode::kAborted));
  EXPECT_THAT(Value(Read()->ListEvidence(other_)), IsEmpty());
  EXPECT_EQ(Value(Read()->FindFindings(other_)), std::nullopt);
  EXPECT_THAT(Value(Read()->ListChanges(scene_.map)), IsEmpty());
}

}  // namespace
}  // namespace mapp
