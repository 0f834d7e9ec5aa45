// Every revision stays readable, on every engine: causes, tags, differences, and reads AS OF a revision.
#include "mapp/base/rng.h"
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <map>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::IsEmpty;

class MapStoreHistoryTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
  }

  Revision Now() { return Value(Read()->GetMap(scene_.map)).revision; }
  std::unique_ptr<MapReader> ReadAsOf(uint64_t revision) {
    return Value(store().ReadAsOf(scene_.map, Revision(revision)));
  }
  MapPointId Insert(MapWriter& writer, uint64_t session_point, double x_m) {
    return Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, session_point, {x_m, 0, 0})));
  }
  FrameId InsertFrame(MapWriter& writer, uint32_t number, double x_m) {
    return Value(writer.InsertFrame(TestFrame(scene_.map, scene_.session, scene_.camera, number, PoseAt(x_m, 0, 0)),
                                    TestBytes(number, 40), {}));
  }

  Scene scene_;
};

/// Writes at random, several operations a change, some on the same thing.
class RandomWrites {
 public:
  RandomWrites(const Scene& scene, uint64_t seed) : scene_(scene), sessions_{scene.session}, rng_(seed) {}

  void Apply(MapWriter& writer) {
    const uint64_t num_operations = 1 + rng_.Below(4);
    for (uint64_t i = 0; i < num_operations; ++i) ApplyOne(writer);
  }

 private:
  double RandomX() { return rng_.Uniform(-30, 30); }
  bool Toss() { return rng_.Below(2) != 0; }
  SessionId AnySession() { return sessions_[rng_.Below(sessions_.size())]; }

  void ApplyOne(MapWriter& writer) {
    switch (rng_.Below(9)) {
      case 0:
        return Grow(writer);
      case 1:
        return ChangeSession(writer);
      case 2:
        return ChangeFrame(writer);
      case 3:
        return TagAtRandom(writer);
      case 4:
        // Below, every other change makes a revision.
        return num_frames_ == 0 ? Grow(writer) : ChangeSession(writer);
      default:
        return ChangePoint(writer);
    }
  }

  void Grow(MapWriter& writer) {
    const SessionId session = AnySession();
    const MapPointId point =
        Value(writer.InsertPoint(scene_.map, TestPoint(session, rng_.Below(50), {RandomX(), 0, 0}, Toss())));
    FrameRecord frame = TestFrame(scene_.map, session, scene_.camera, num_frames_++, PoseAt(RandomX(), 0, 0));
    frame.in_map = Toss();
    const std::vector<Observation> observations = {{.feature_idx = 3, .point = point, .depth_m = 1}};
    frames_.push_back(Value(writer.InsertFrame(frame, TestBytes(num_frames_, 30), observations)));
  }

  void ChangePoint(MapWriter& writer) {
    const std::vector<PointRecord> points = Value(writer.PointsOfSession(AnySession()));
    if (points.size() < 2) return Grow(writer);
    const size_t chosen = rng_.Below(points.size());
    PointRecord point = points[chosen];
    switch (rng_.Below(4)) {
      case 0:
        return Check(writer.RetirePoint(
            point.id, Toss() ? std::optional(points[(chosen + 1) % points.size()].id) : std::nullopt));
      case 1:
        ++point.num_observations;
        return Check(writer.TouchPoint(point));
      default:
        point.position.x() = RandomX();
        point.in_map = Toss();
        return Check(writer.UpdatePoint(point));
    }
  }

  void ChangeFrame(MapWriter& writer) {
    if (frames_.empty()) return Grow(writer);
    const FrameId frame = frames_[rng_.Below(frames_.size())];
    if (Toss()) return Check(writer.SetFramePose(frame, Toss(), PoseAt(RandomX(), 0, 0)));
    const std::vector<Observation> observations(rng_.Below(5),
                                                {.feature_idx = 0, .point = MapPointId(1), .depth_m = 1});
    Check(writer.SetObservations(frame, observations));
  }

  void ChangeSession(MapWriter& writer) {
    SessionRecord session = Value(writer.GetSession(AnySession()));
    switch (rng_.Below(5)) {
      case 0:
        session.T_map_session = PoseAt(RandomX(), 1, 0);
        session.scale_map_session = rng_.Uniform(1, 2);
        session.aligned_at_keyframe = 3;
        return Check(writer.UpdateSession(session));
      case 1:
        session.closed_ns = static_cast<int64_t>(rng_.Below(1000));
        session.quarantine = Quarantine{5, "looks wrong", std::nullopt};
        return Check(writer.UpdateSession(session));
      case 2:
        return Check(writer.SetFounder(scene_.map, session.id));
      case 3:
        return Check(writer.SetMetricScale(scene_.map, Toss()));
      default:
        session.id = {};
        session.T_map_session.reset();
        sessions_.push_back(Value(writer.InsertSession(session)));
    }
  }

  void TagAtRandom(MapWriter& writer) {
    const Revision now = Value(writer.GetMap(scene_.map)).revision;
    Check(writer.PutTag(scene_.map, fmt::format("tag-{}", rng_.Below(4)), now));
  }

  const Scene scene_;
  std::vector<SessionId> sessions_;
  std::vector<FrameId> frames_;
  uint32_t num_frames_ = 0;
  Rng rng_;
};

TEST_P(MapStoreHistoryTest, ReadsAsOfARevisionEqualTheMapAsItWasThen) {
  RandomWrites elsewhere(NewScene("elsewhere"), 100);
  for (uint64_t seed = 1; seed <= 4; ++seed) {
    const Scene scene = NewScene(fmt::format("map {}", seed));
    RandomWrites writes(scene, seed);
    std::map<Revision, std::string> expected;
    const auto note = [&] { expected[Value(Read()->GetMap(scene.map)).revision] = DumpMap(*Read(), scene.map); };
    note();
    for (int i = 0; i < 60; ++i) {
      MustWrite([&](MapWriter& writer) { writes.Apply(writer); });
      note();
      if (i % 5 == 0) MustWrite([&](MapWriter& writer) { elsewhere.Apply(writer); });
    }
    ASSERT_GT(expected.size(), 30U);
    for (const auto& [revision, dump] : expected) {
      const auto reader = Value(store().ReadAsOf(scene.map, revision));
      ASSERT_EQ(DumpMap(*reader, scene.map), dump) << "seed " << seed << " revision " << revision.value();
      EXPECT_EQ(Value(reader->ListMaps()).size(), 1U);
    }
  }
}

TEST_P(MapStoreHistoryTest, AnEarlierStateStaysAsItIsWhileTheMapGoesOn) {
  MapPointId point;
  MustWrite([&](MapWriter& writer) { point = Insert(writer, 1, 1); });
  const auto before = ReadAsOf(1);
  MustWrite([&](MapWriter& writer) { Check(writer.RetirePoint(point, std::nullopt)); });
  EXPECT_THAT(Value(before->FindPoints(std::span(&point, 1))), testing::SizeIs(1));
  EXPECT_THAT(Value(ReadAsOf(2)->FindPoints(std::span(&point, 1))), IsEmpty());
  EXPECT_THAT(Value(ReadAsOf(0)->FindPoints(std::span(&point, 1))), IsEmpty());
}

TEST_P(MapStoreHistoryTest, WhatIsOfAnotherMapOrTimeDoesNotExistThere) {
  const Scene other = NewScene("elsewhere");
  MustWrite([&](MapWriter& writer) { Insert(writer, 1, 1); });
  FrameId late;
  MustWrite([&](MapWriter& writer) { late = InsertFrame(writer, 0, 0); });
  const auto reader = ReadAsOf(1);
  EXPECT_THAT(reader->FindMap("elsewhere"), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetMap(other.map), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetSession(other.session), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetFrame(late), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetPacket(late), HasCode(StatusCode::kNotFound));
  EXPECT_EQ(Value(reader->FindFrame(scene_.session, 0)), std::nullopt);
  EXPECT_THAT(Value(reader->ListSessions(std::nullopt)), testing::SizeIs(1));
}

TEST_P(MapStoreHistoryTest, RevisionsThatAreNotThereAreNamed) {
  MustWrite([&](MapWriter& writer) { Insert(writer, 1, 1); });
  const auto later = store().ReadAsOf(scene_.map, Revision(2));
  EXPECT_THAT(later, HasCode(StatusCode::kOutOfRange));
  EXPECT_THAT(std::string(later.status().message()), testing::HasSubstr("no revision 2: its last one is 1"));
  EXPECT_THAT(store().ReadAsOf(MapId(77), Revision(0)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Read()->DiffRevisions(scene_.map, Revision(0), Revision(2)), HasCode(StatusCode::kOutOfRange));
  EXPECT_THAT(Read()->DiffRevisions(scene_.map, Revision(1), Revision(0)), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(Read()->ListRevisions(MapId(77), Revision(0), Revision(9)), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreHistoryTest, RevisionsSayWhatTheyWereMadeFor) {
  MustWrite([&](MapWriter& writer) { InsertFrame(writer, 0, 0); });
  MustWrite([&](MapWriter& writer) {
    Check(writer.SetCause(scene_.map, RevisionCause::kLoop, scene_.session));
    InsertFrame(writer, 1, 0);
  });
  MustWrite([&](MapWriter& writer) {
    Insert(writer, 1, 1);
    Check(writer.SetCause(scene_.map, RevisionCause::kFusion, std::nullopt));
  });
  MustWrite([&](MapWriter& writer) { Insert(writer, 2, 1); });
  MustWrite([&](MapWriter& writer) {
    EXPECT_THAT(writer.SetCause(scene_.map, RevisionCause::kUnknown, std::nullopt),
                HasCode(StatusCode::kInvalidArgument));
  });
  const auto revisions = Value(Read()->ListRevisions(scene_.map, Revision(1), Revision(UINT64_MAX)));
  ASSERT_EQ(revisions.size(), 4U);
  EXPECT_EQ(revisions[0].cause, RevisionCause::kKeyframe);
  EXPECT_EQ(revisions[0].session, scene_.session);
  EXPECT_EQ(revisions[1].cause, RevisionCause::kLoop);
  EXPECT_EQ(revisions[1].session, scene_.session);
  EXPECT_EQ(revisions[2].cause, RevisionCause::kFusion);
  EXPECT_EQ(revisions[2].session, std::nullopt);
  EXPECT_EQ(revisions[3].cause, RevisionCause::kUnknown);
  EXPECT_GT(revisions[3].committed_ns, 0);
  EXPECT_THAT(Value(Read()->ListRevisions(scene_.map, Revision(2), Revision(3))), testing::SizeIs(2));
  EXPECT_THAT(Value(ReadAsOf(2)->ListRevisions(scene_.map, Revision(1), Revision(9))), testing::SizeIs(2));
}

TEST_P(MapStoreHistoryTest, TagsNameRevisions) {
  MustWrite([&](MapWriter& writer) { Insert(writer, 1, 1); });
  MustWrite([&](MapWriter& writer) {
    Check(writer.PutTag(scene_.map, "spring", Revision(0)));
    Check(writer.PutTag(scene_.map, "autumn", Revision(1)));
    Check(writer.PutTag(scene_.map, "spring", Revision(1)));
    EXPECT_THAT(writer.PutTag(scene_.map, "winter", Revision(2)), HasCode(StatusCode::kOutOfRange));
    EXPECT_THAT(writer.PutTag(scene_.map, "12", Revision(1)), HasCode(StatusCode::kInvalidArgument));
    EXPECT_THAT(writer.PutTag(scene_.map, "", Revision(1)), HasCode(StatusCode::kInvalidArgument));
    EXPECT_THAT(writer.PutTag(MapId(77), "x", Revision(0)), HasCode(StatusCode::kNotFound));
  });
  EXPECT_EQ(Now(), Revision(1)) << "a tag makes no revision";
  std::vector<TagRecord> tags = Value(Read()->ListTags(scene_.map));
  ASSERT_EQ(tags.size(), 2U);
  EXPECT_EQ(tags[0].name, "autumn");
  EXPECT_EQ(tags[1].name, "spring");
  EXPECT_EQ(tags[1].revision, Revision(1));
  EXPECT_GT(tags[1].created_ns, 0);
  MustWrite([&](MapWriter& writer) {
    Check(writer.DeleteTag(scene_.map, "spring"));
    EXPECT_THAT(writer.DeleteTag(scene_.map, "spring"), HasCode(StatusCode::kNotFound));
  });
  EXPECT_THAT(Value(Read()->ListTags(scene_.map)), testing::SizeIs(1));
}

TEST_P(MapStoreHistoryTest, DifferencesAreCountedBySession) {
  MapPointId moved, gone, brief;
  FrameId frame;
  MustWrite([&](MapWriter& writer) {
    moved = Insert(writer, 1, 1);
    gone = Insert(writer, 2, 2);
    frame = InsertFrame(writer, 0, 0);
  });
  MustWrite([&](MapWriter& writer) {
    PointRecord point = Value(writer.FindPoints(std::span(&moved, 1))).at(0);
    point.position.x() = 5;
    Check(writer.UpdatePoint(point));
    Check(writer.RetirePoint(gone, std::nullopt));
    brief = Insert(writer, 3, 3);
    Insert(writer, 4, 4);
    InsertFrame(writer, 1, 0);
    Check(writer.SetFramePose(frame, true, PoseAt(1, 0, 0)));
  });
  MustWrite([&](MapWriter& writer) { Check(writer.RetirePoint(brief, std::nullopt)); });
  MustWrite([&](MapWriter& writer) { Check(writer.SetFramePose(frame, false, PoseAt(1, 0, 0))); });
  const auto diff = [&](uint64_t from, uint64_t to) {
    return Value(Read()->DiffRevisions(scene_.map, Revision(from), Revision(to)));
  };
  EXPECT_THAT(diff(2, 2), IsEmpty());
  EXPECT_THAT(diff(0, 1), ElementsAre(SessionDiff{scene_.session, 1, 0, 0, 2, 0, 0}));
  EXPECT_THAT(diff(1, 2), ElementsAre(SessionDiff{scene_.session, 1, 1, 0, 2, 1, 1}));
  EXPECT_THAT(diff(1, 3), ElementsAre(SessionDiff{scene_.session, 1, 1, 0, 1, 1, 1}));
  EXPECT_THAT(diff(2, 3), ElementsAre(SessionDiff{scene_.session, 0, 0, 0, 0, 0, 1}));
  EXPECT_THAT(diff(1, 4), ElementsAre(SessionDiff{scene_.session, 1, 0, 1, 1, 1, 1}));
  EXPECT_THAT(Value(ReadAsOf(3)->DiffRevisions(scene_.map, Revision(2), Revision(3))), testing::SizeIs(1));
}

/// DiffRevisions by comparing two states as they are read.
std::vector<SessionDiff> DiffByReading(MapStore& store, MapId map, Revision from, Revision to) {
  std::map<SessionId, SessionDiff> diffs;
  const auto before = Value(store.ReadAsOf(map, from));
  const auto after = Value(store.ReadAsOf(map, to));
  std::map<FrameId, std::pair<const FrameRecord*, const FrameRecord*>> frames;
  const auto old_frames = Value(before->ListFrames(map, std::nullopt));
  const auto new_frames = Value(after->ListFrames(map, std::nullopt));
  for (const FrameRecord& frame : old_frames) frames[frame.id].first = &frame;
  for (const FrameRecord& frame : new_frames) frames[frame.id].second = &frame;
  for (const auto& [id, pair] : frames) {
    const bool was = pair.first != nullptr && pair.first->in_map;
    const bool is = pair.second != nullptr && pair.second->in_map;
    SessionDiff& diff = diffs[pair.second->session];
    if (!was && is) ++diff.frames_added;
    if (was && !is) ++diff.frames_removed;
    if (was && is && Distance(pair.first->T_frame_camera, pair.second->T_frame_camera) > 0) ++diff.frames_moved;
  }
  std::map<MapPointId, std::pair<std::optional<PointRecord>, std::optional<PointRecord>>> points;
  for (const SessionRecord& session : Value(after->ListSessions(map))) {
    if (before->GetSession(session.id).ok()) {
      for (const PointRecord& point : Value(before->PointsOfSession(session.id))) points[point.id].first = point;
    }
    for (const PointRecord& point : Value(after->PointsOfSession(session.id))) points[point.id].second = point;
  }
  for (const auto& [id, pair] : points) {
    const bool was = pair.first && pair.first->in_map;
    const bool is = pair.second && pair.second->in_map;
    SessionDiff& diff = diffs[pair.second ? pair.second->session : pair.first->session];
    if (!was && is) ++diff.points_added;
    if (was && !is) ++diff.points_removed;
    if (was && is && pair.first->position != pair.second->position) ++diff.points_moved;
  }
  std::vector<SessionDiff> result;
  for (auto& [session, diff] : diffs) {
    if (diff == SessionDiff{}) continue;
    diff.session = session;
    result.push_back(diff);
  }
  return result;
}

TEST_P(MapStoreHistoryTest, DifferencesAreThoseBetweenTheStates) {
  RandomWrites writes(scene_, 7);
  for (int i = 0; i < 60; ++i) MustWrite([&](MapWriter& writer) { writes.Apply(writer); });
  const Revision last = Now();
  Rng rng(3);
  for (int i = 0; i < 40; ++i) {
    const Revision from(rng.Below(last.value() + 1));
    const Revision to(from.value() + rng.Below(last.value() - from.value() + 1));
    ASSERT_EQ(Value(Read()->DiffRevisions(scene_.map, from, to)), DiffByReading(store(), scene_.map, from, to))
        << from.value() << " to " << to.value();
  }
}

TEST_P(MapStoreHistoryTest, DroppedHistoryTakesNothingFromWhatIsKept) {
  for (uint64_t seed = 21; seed <= 24; ++seed) {
    const Scene scene = NewScene(fmt::format("map {}", seed));
    RandomWrites writes(scene, seed);
    std::map<Revision, std::string> expected;
    for (int i = 0; i < 60; ++i) {
      MustWrite([&](MapWriter& writer) { writes.Apply(writer); });
      expected[Value(Read()->GetMap(scene.map)).revision] = DumpMap(*Read(), scene.map);
    }
    const std::string others = DumpMap(*Read(), scene_.map);
    const Revision oldest = std::next(expected.begin(), static_cast<int>(5 * (seed - 20)))->first;
    const int64_t num_rows = Value(Read()->CountHistory(scene.map, oldest));
    ASSERT_GT(num_rows, 0);
    int64_t num_dropped = 0;
    for (int64_t now = -1; now != 0; num_dropped += now) {
      MustWrite([&](MapWriter& writer) { now = Value(writer.DropHistory(scene.map, oldest, 3)); });
    }
    EXPECT_EQ(num_dropped, num_rows);
    EXPECT_EQ(Value(Read()->CountHistory(scene.map, oldest)), 0);
    EXPECT_EQ(Value(Read()->GetMap(scene.map)).oldest_revision, oldest);
    EXPECT_EQ(DumpMap(*Read(), scene_.map), others);
    for (const auto& [revision, dump] : expected) {
      const auto reader = store().ReadAsOf(scene.map, revision);
      if (revision < oldest) {
        EXPECT_THAT(reader, HasCode(StatusCode::kOutOfRange));
        EXPECT_THAT(std::string(reader.status().message()), testing::HasSubstr("has been compacted away"));
      } else {
        ASSERT_EQ(DumpMap(*Value(store().ReadAsOf(scene.map, revision)), scene.map), dump)
            << "seed " << seed << " revision " << revision.value() << " oldest " << oldest.value();
      }
    }
    EXPECT_EQ(DumpMap(*Read(), scene.map), expected.rbegin()->second);
  }
}

TEST_P(MapStoreHistoryTest, OldestRevisionOnlyGrowsAndIsOneThatThereIs) {
  MustWrite([&](MapWriter& writer) { Insert(writer, 1, 1); });
  MustWrite([&](MapWriter& writer) { Insert(writer, 2, 1); });
  MustWrite([&](MapWriter& writer) {
    Value(writer.DropHistory(scene_.map, Revision(1), 10));
    EXPECT_THAT(writer.DropHistory(scene_.map, Revision(0), 10), HasCode(StatusCode::kOutOfRange));
    EXPECT_THAT(writer.DropHistory(scene_.map, Revision(3), 10), HasCode(StatusCode::kOutOfRange));
    EXPECT_THAT(writer.DropHistory(MapId(77), Revision(0), 10), HasCode(StatusCode::kNotFound));
  });
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).oldest_revision, Revision(1));
  EXPECT_EQ(Now(), Revision(2));
}

TEST_P(MapStoreHistoryTest, UnusedSpaceIsGivenBackInSteps) {
  MustWrite([&](MapWriter& writer) {
    for (uint32_t number = 0; number < 20; ++number) {
      Value(writer.InsertFrame(TestFrame(scene_.map, scene_.session, scene_.camera, number, PoseAt(0, 0, 0)),
                               TestBytes(number, 50'000), {}));
    }
  });
  MustWrite([&](MapWriter& writer) { Check(writer.DeleteMap(scene_.map)); });
  int64_t left = -1;
  for (int64_t before = INT64_MAX; left != 0; before = left) {
    MustWrite([&](MapWriter& writer) { left = Value(writer.GiveBackSpace(100'000)); });
    ASSERT_LT(left, before);
  }
}

INSTANTIATE_TEST_SUITE_P(Engines, MapStoreHistoryTest, testing::ValuesIn(AllEngines()), EngineName);

}  // namespace
}  // namespace mapp
