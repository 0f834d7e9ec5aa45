// One contributor's whole contribution is taken out, and brought back.

#include "tests/unit/server/quarantine_fixture.h"

namespace mapp::testing {
namespace {

class ReversionTest : public QuarantineTest {
 protected:
  /// A session that came to the map and went round in it.
  SessionId Contribute() {
    const SessionId session = OpenAligned();
    const Status walked = WalkOn(session, Round(8, 0.4), 5, {}, world_);
    EXPECT_TRUE(walked.ok()) << walked;
    return session;
  }
  void Close(SessionId session) {
    SessionLog log(*service_, session);
    const auto closed = service_->CloseSession(context_, session);
    EXPECT_TRUE(closed.ok()) << closed.status();
    EXPECT_TRUE(!closed->optimization_pending || log.WaitFor<OptimizationFinished>());
  }
  RevertedSession Revert(SessionId session) {
    const auto reverted = service_->RevertSession(context_, session, "", /*dry_run=*/false);
    EXPECT_TRUE(reverted.ok()) << reverted.status();
    Settle();
    return *reverted;
  }
  std::string Reason(SessionId session) { return Session(session).quarantine->reason; }
};

TEST_F(ReversionTest, LeavesWhatWasThereBefore) {
  const MapContent before = Content();
  const SessionId session = Contribute();
  ASSERT_GT(Content().frames.size(), before.frames.size());
  const RevertedSession reverted = Revert(session);
  EXPECT_EQ(reverted.num_frames, 13U);
  EXPECT_GT(reverted.map_revision, Revision(0));
  ExpectSame(before, Content(), /*some_observers=*/true);
  EXPECT_TRUE(Session(session).IsQuarantined());
  EXPECT_EQ(Reason(session), "reverted by an operator");
  // Nothing more of it comes in.
  EXPECT_TRUE(absl::IsFailedPrecondition(WalkOn(session, {SyntheticWorld::Stand(0, 0, 0)}, 90, {}, world_)));
}

TEST_F(ReversionTest, ReleasingBringsItBackWhereItWas) {
  const SessionId session = Contribute();
  const MapContent before = Content();
  Revert(session);
  const auto released = service_->ReleaseSession(context_, session);
  ASSERT_TRUE(released.ok()) << released.status();
  EXPECT_EQ(released->num_frames_taken_in, 13U);
  const MapContent after = Content();
  ASSERT_EQ(before.frames.size(), after.frames.size());
  for (const auto& [id, pose] : before.frames) EXPECT_LT(Distance(pose, after.frames.at(id)), 1e-9);
  // Points are founded again: associated with others' at once, where the first time they were a fragment's.
  EXPECT_NEAR(static_cast<double>(before.points.size()), static_cast<double>(after.points.size()),
              0.1 * static_cast<double>(before.points.size()));
  EXPECT_TRUE(WalkOn(session, {SyntheticWorld::Stand(0, 0, 0)}, 90, {}, world_).ok());
}

TEST_F(ReversionTest, WhatOthersObserveStays) {
  const SessionId session = Contribute();
  const std::set<FrameId> others = [&] {
    std::set<FrameId> ids;
    for (const FrameRecord& frame : Frames(session)) ids.insert(frame.id);
    return ids;
  }();
  std::map<MapPointId, size_t> observed;
  {
    const auto reader = *store_->Read();
    for (const FrameId frame : others) {
      const auto observations = reader->GetObservations(frame);
      for (const Observation& observation : *observations) ++observed[observation.point];
    }
  }
  const MapContent before = Content();
  Revert(founder_);
  const MapContent after = Content();
  EXPECT_EQ(after.frames.size(), others.size());
  EXPECT_EQ(after.points.size(), observed.size()) << "all that are observed, and no others";
  for (const auto& [id, point] : after.points) {
    EXPECT_TRUE(observed.contains(id));
    ASSERT_FALSE(point.observers.empty());
    for (const FrameId frame : point.observers) EXPECT_TRUE(others.contains(frame));
    EXPECT_EQ(point.position, before.points.at(id).position);
  }
}

TEST_F(ReversionTest, SessionsThatSharedPointsAreOptimizedAgain) {
  const SessionId session = Contribute();
  const SessionId other = Contribute();
  Close(other);
  ASSERT_TRUE(Session(other).optimized);
  const Revision optimized = *Session(other).optimized;
  SessionLog log(*service_, other);
  EXPECT_EQ(Revert(session).num_sessions_to_optimize, 1U);
  ASSERT_TRUE(log.WaitFor<OptimizationFinished>());
  EXPECT_GT(*Session(other).optimized, optimized);
}

TEST_F(ReversionTest, ADryRunChangesNothing) {
  const SessionId session = Contribute();
  const MapContent before = Content();
  const Revision revision = Map().revision;
  const auto dry = service_->RevertSession(context_, session, "", /*dry_run=*/true);
  ASSERT_TRUE(dry.ok()) << dry.status();
  EXPECT_EQ(dry->num_frames, 13U);
  EXPECT_EQ(Map().revision, revision);
  EXPECT_FALSE(Session(session).quarantine);
  ExpectSame(before, Content());
  EXPECT_EQ(Revert(session).num_points, dry->num_points);
}

TEST_F(ReversionTest, AnEmptiedMapBeginsAnew) {
  const SessionId founder = Open(SensorKind::kRgbd, "other");
  MustUpload(world_, SyntheticWorld::Stand(0, 0, 0), founder, 0);
  Revert(founder);
  EXPECT_EQ(Map("other").num_frames, 0);
  EXPECT_EQ(Map("other").num_points, 0);
  const SessionId next = Open(SensorKind::kRgbd, "other");
  const UploadResult founded = MustUpload(world_, SyntheticWorld::Stand(0, -1, 0.3), next, 0);
  EXPECT_TRUE(founded.T_map_session) << "nobody's frame is the map's";
  EXPECT_EQ(Map("other").founder, next);
  EXPECT_FALSE(Session(founder).T_map_session) << "its place was told in a frame that is gone";
  const auto released = service_->ReleaseSession(context_, founder);
  ASSERT_TRUE(released.ok()) << released.status();
  EXPECT_EQ(released->num_frames_taken_in, 0U);
}

TEST_F(ReversionTest, AFounderAloneComesBackAsFounder) {
  const SessionId founder = Open(SensorKind::kRgbd, "other");
  MustUpload(world_, SyntheticWorld::Stand(0, 0, 0), founder, 0);
  Revert(founder);
  const auto released = service_->ReleaseSession(context_, founder);
  ASSERT_TRUE(released.ok()) << released.status();
  EXPECT_EQ(released->num_frames_taken_in, 1U);
  EXPECT_EQ(Map("other").num_frames, 1);
}

TEST_F(ReversionTest, AFragmentNeverEnters) {
  const SessionId fragment = Open();
  MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, 0, 0), fragment, 0);
  const Revision revision = Map().revision;
  const auto reverted = service_->RevertSession(context_, fragment, "of another house", /*dry_run=*/false);
  ASSERT_TRUE(reverted.ok()) << reverted.status();
  EXPECT_EQ(reverted->map_revision, Revision(0));
  EXPECT_EQ(Map().revision, revision);
  EXPECT_EQ(Reason(fragment), "reverted by an operator: of another house");
}

TEST_F(ReversionTest, RefusesWhatIsNotThere) {
  EXPECT_TRUE(absl::IsNotFound(service_->RevertSession(context_, SessionId(4711), "", false).status()));
  const SessionId session = Contribute();
  Revert(session);
  const Status again = service_->RevertSession(context_, session, "", false).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(again)) << again;
}

/// Frames and points of a map as a reader has them.
struct State {
  std::map<FrameId, std::pair<Eigen::Vector3d, size_t>> frames;
  std::map<MapPointId, Eigen::Vector3d> points;
  friend bool operator==(const State&, const State&) = default;
};

State StateOf(MapReader& reader, MapId map) {
  State state;
  const auto frames = reader.ListFrames(map, std::nullopt);
  EXPECT_TRUE(frames.ok()) << frames.status();
  for (const FrameRecord& frame : *frames) {
    if (!frame.in_map) continue;
    state.frames[frame.id] = {frame.T_frame_camera.translation(), reader.GetObservations(frame.id)->size()};
  }
  const auto tiles = reader.ListTiles(map, std::nullopt);
  EXPECT_TRUE(tiles.ok()) << tiles.status();
  for (const TileRecord& tile : *tiles) {
    const auto points = reader.PointsInTile(map, tile.key);
    EXPECT_TRUE(points.ok()) << points.status();
    for (const PointRecord& point : *points) state.points[point.id] = point.position;
  }
  return state;
}

class HistoryPropertyTest : public ReversionTest, public ::testing::WithParamInterface<uint64_t> {};

TEST_P(HistoryPropertyTest, EveryRevisionReadsAsTheMapWasThen) {
  Rng choice(GetParam());
  const MapId map = Map().id;
  std::map<Revision, State> copies;
  const auto copy = [&] {
    const auto reader = *store_->Read();
    const Revision revision = reader->GetMap(map)->revision;
    copies[revision] = StateOf(*reader, map);
  };
  std::vector<SessionId> sessions = {founder_};
  uint32_t number = 100;
  const auto step = [&] {
    const SessionId session = sessions[choice.Below(sessions.size())];
    context_ = CallContext::WithTimeout(std::chrono::seconds(30));
    const bool is_out = Session(session).IsQuarantined();
    switch (choice.Below(7)) {
      case 0:
        sessions.push_back(Contribute());
        return;
      case 1:
        if (!is_out && session != founder_) Revert(session);
        return;
      case 2:
        EXPECT_TRUE(!is_out || service_->ReleaseSession(context_, session).ok());
        return;
      case 3:
        EXPECT_TRUE(service_->OptimizeMap(context_, "room", {}).ok());
        return;
      case 4: {
        const CompactionRequest request{
            .map_name = "room", .keep_revisions = 30 + choice.Below(30), .keep_days = {}, .dry_run = false};
        EXPECT_TRUE(service_->CompactMap(context_, request, {}).ok());
        return;
      }
      case 5: {
        // As when a change of the world is applied and undone: every third point of a session goes and comes back.
        std::vector<PointRecord> points = *(*store_->Read())->PointsOfSession(session);
        std::erase_if(points, [](const PointRecord& point) { return !point.in_map || point.id.value() % 3 != 0; });
        const auto for_each = [&](const std::function<Status(MapWriter&, const PointRecord&)>& change) {
          EXPECT_TRUE(store_
                          ->Write(context_,
                                  [&](MapWriter& writer) -> Status {
                                    for (const PointRecord& point : points) MAPP_RETURN_IF_ERROR(change(writer, point));
                                    return absl::OkStatus();
                                  })
                          .ok());
          copy();
        };
        for_each(
            [](MapWriter& writer, const PointRecord& point) { return writer.RetirePoint(point.id, std::nullopt); });
        for_each([](MapWriter& writer, const PointRecord& point) { return writer.ReturnPoint(point); });
        return;
      }
      default:
        if (is_out) return;
        for (int i = 0; i < 3; ++i) {
          MustUpload(world_, SyntheticWorld::Stand(0.1 * i, -0.3, 0.2 * i), session, number++, kFirstPoint);
          copy();
        }
    }
  };
  for (int i = 0; i < 20; ++i) {
    step();
    copy();
  }
  const Revision oldest = Map().oldest_revision;
  size_t num_compared = 0;
  for (const auto& [revision, state] : copies) {
    if (revision < oldest) continue;
    const auto reader = store_->ReadAsOf(map, revision);
    ASSERT_TRUE(reader.ok()) << reader.status();
    EXPECT_TRUE(StateOf(**reader, map) == state) << "revision " << revision.value() << " of " << Map().revision.value();
    ++num_compared;
  }
  EXPECT_GT(num_compared, 3U);
}
INSTANTIATE_TEST_SUITE_P(Seeds, HistoryPropertyTest, ::testing::Range<uint64_t>(1, 6));

}  // namespace
}  // namespace mapp::testing
