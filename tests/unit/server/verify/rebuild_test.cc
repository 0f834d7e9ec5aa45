// The map is derived data: from the keyframe log alone it is made again.

#include "server/rebuild/rebuild.h"

#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/quarantine_fixture.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <gmock/gmock.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <tuple>

namespace mapp::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Of an optimization that shares its sums among threads.
constexpr double kToleranceM = 1e-3;

/// A map as its frames and points tell it; ids of points aside.
struct Derived {
  struct Session {
    bool is_aligned = false, is_closed = false, is_quarantined = false;
    std::string reason;
    int64_t opened_ns = 0, num_keyframes = 0;
    friend bool operator==(const Session&, const Session&) = default;
  };
  std::map<SessionId, Session> sessions;
  std::map<FrameId, std::pair<bool, Pose3>> frames;
  std::map<FrameId, std::string> packets;
  std::map<std::tuple<SessionId, uint64_t, bool>, Eigen::Vector3d> points;  ///< by session, number, whether in the map
};

Derived ReadDerived(const std::string& file) {
  Derived derived;
  const auto store = OpenSqliteMapStore(file, {.read_only = true});
  EXPECT_TRUE(store.ok()) << store.status();
  const auto reader = *(*store)->Read();
  const std::vector<MapRecord> maps = *reader->ListMaps();
  for (const MapRecord& map : maps) {
    const std::vector<FrameRecord> frames = *reader->ListFrames(map.id, std::nullopt);
    for (const FrameRecord& frame : frames) {
      derived.frames[frame.id] = {frame.in_map, frame.T_frame_camera};
      derived.packets[frame.id] = *reader->GetPacket(frame.id);
    }
    const std::vector<SessionRecord> sessions = *reader->ListSessions(map.id);
    for (const SessionRecord& session : sessions) {
      derived.sessions[session.id] = {session.T_map_session.has_value(),
                                      session.closed_ns.has_value(),
                                      session.IsQuarantined(),
                                      session.quarantine ? session.quarantine->reason : std::string(),
                                      session.opened_ns,
                                      session.num_keyframes};
      const std::vector<PointRecord> points = *reader->PointsOfSession(session.id);
      for (const PointRecord& point : points) {
        derived.points[{point.session, point.session_point, point.in_map}] = point.position;
      }
    }
  }
  return derived;
}

void ExpectSameMap(const Derived& before, const Derived& after, double tolerance_m) {
  EXPECT_TRUE(before.sessions == after.sessions);
  EXPECT_TRUE(before.packets == after.packets);
  ASSERT_EQ(before.frames.size(), after.frames.size());
  for (const auto& [id, frame] : before.frames) {
    ASSERT_TRUE(after.frames.contains(id)) << id.value();
    EXPECT_EQ(frame.first, after.frames.at(id).first) << "in the map: frame " << id.value();
    EXPECT_LE(Distance(frame.second, after.frames.at(id).second), tolerance_m) << id.value();
  }
  size_t num_missing = 0, num_moved = 0;
  for (const auto& [key, position] : before.points) {
    const auto found = after.points.find(key);
    if (found == after.points.end()) {
      ++num_missing;
    } else if (!((found->second - position).norm() <= 10 * tolerance_m)) {
      ++num_moved;
    }
  }
  EXPECT_EQ(num_missing, 0U);
  EXPECT_EQ(num_moved, 0U);
  EXPECT_EQ(before.points.size(), after.points.size());
}

class RebuildTest : public QuarantineTest {
 protected:
  /// A session whose keyframes do not come faster than they are compared with the map.
  SessionId Contribute() {
    const SessionId session = Open();
    for (uint32_t i = 0; i < 12; ++i) {
      MustUpload(world_, SyntheticWorld::Stand(0.1 * i, -0.5, 0.15 * i), session, i, kFirstPoint);
      service_->WaitUntilIdle();
    }
    EXPECT_TRUE(Session(session).T_map_session);
    return session;
  }
  void Close(SessionId session) {
    const auto closed = service_->CloseSession(context_, session);
    EXPECT_TRUE(closed.ok()) << closed.status();
    service_->WaitUntilIdle();
  }
  /// The service's database, closed for good.
  std::string Stop() {
    service_.reset();
    EXPECT_TRUE(store_->Close().ok());
    return (folder_ / "map.db").string();
  }
  std::string File(const std::string& name) const { return (folder_ / name).string(); }

  static RebuildReport MustRebuild(const std::string& from, const std::string& to) {
    const auto report = RebuildDatabase({}, from, to, {});
    EXPECT_TRUE(report.ok()) << report.status();
    const auto verified = Verify(to);
    EXPECT_TRUE(verified.ok()) << verified.status();
    EXPECT_EQ(verified->num_violations(), 0) << Describe(*verified);
    return report.ok() ? *report : RebuildReport();
  }
};

TEST_F(RebuildTest, GivesTheSameMap) {
  const SessionId session = Contribute();
  Close(session);
  MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, 0, 0), Open(), 0);  // a fragment
  ASSERT_TRUE(service_->OptimizeMap(context_, "room", {}).ok());
  Close(Contribute());
  ASSERT_TRUE(service_->PutTag(context_, "room", "spring", "").ok());
  const std::string original = Stop();
  const RebuildReport report = MustRebuild(original, File("rebuilt.db"));
  EXPECT_THAT(report.problems, IsEmpty());
  ASSERT_EQ(report.maps.size(), 1U);
  EXPECT_EQ(report.maps[0].num_frames, report.maps[0].num_frames_before);
  EXPECT_EQ(report.maps[0].num_points, report.maps[0].num_points_before);
  EXPECT_LT(report.maps[0].max_moved_m, kToleranceM);
  EXPECT_THAT(report.maps[0].dropped_tags, ElementsAre("spring"));
  ExpectSameMap(ReadDerived(original), ReadDerived(File("rebuilt.db")), kToleranceM);

  // What was made with one thread is made again bit for bit.
  MustRebuild(File("rebuilt.db"), File("again.db"));
  ExpectSameMap(ReadDerived(File("rebuilt.db")), ReadDerived(File("again.db")), 0);
}

TEST_F(RebuildTest, WhatWasTakenOutStaysOut) {
  const SessionId reverted = Contribute();
  const SessionId garbage = OpenAligned();
  ASSERT_FALSE(WalkOn(garbage, Round(24, 0.4), 5, GarbagePose, world_).ok());
  Contribute();
  ASSERT_TRUE(service_->RevertSession(context_, reverted, "", false).ok());
  service_->WaitUntilIdle();
  const std::string original = Stop();
  MustRebuild(original, File("rebuilt.db"));
  const Derived before = ReadDerived(original), after = ReadDerived(File("rebuilt.db"));
  EXPECT_TRUE(before.sessions == after.sessions);
  for (const auto& [id, frame] : before.frames) EXPECT_EQ(frame.first, after.frames.at(id).first) << id.value();
}

TEST_F(RebuildTest, IdsKeepTheirGaps) {
  const SessionId gone = Open(SensorKind::kRgbd, "gone");
  MustUpload(world_, SyntheticWorld::Stand(0, 0, 0), gone, 0);
  const SessionId session = Contribute();
  ASSERT_TRUE(service_->DeleteMap(context_, "gone", /*force=*/true).ok());
  const std::string original = Stop();
  MustRebuild(original, File("rebuilt.db"));
  const Derived after = ReadDerived(File("rebuilt.db"));
  EXPECT_TRUE(after.sessions.contains(session));
  EXPECT_FALSE(after.sessions.contains(gone));
  ExpectSameMap(ReadDerived(original), after, kToleranceM);
}

TEST_F(RebuildTest, ADamagedKeyframeIsNamedAndTheOthersAreTakenOver) {
  const std::string original = Stop();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open_v2(original.c_str(), &db, SQLITE_OPEN_READWRITE, sqlite::ChecksumVfsName()), SQLITE_OK);
  ASSERT_EQ(
      sqlite3_exec(db, "UPDATE keyframe_log SET crc32c = crc32c + 1 WHERE frame_id = 7", nullptr, nullptr, nullptr),
      SQLITE_OK);
  sqlite3_close(db);
  const RebuildReport report = MustRebuild(original, File("rebuilt.db"));
  EXPECT_EQ(report.num_keyframes, kFounderViews - 1);
  EXPECT_THAT(report.problems, ElementsAre(HasSubstr("packet of frame 7")));
}

TEST_F(RebuildTest, BadInputLeavesNothing) {
  const std::string original = Stop();
  std::ofstream(File("there.db")) << "somebody's";
  EXPECT_EQ(RebuildDatabase({}, original, File("there.db"), {}).status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(RebuildDatabase({}, File("missing.db"), File("new.db"), {}).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(RebuildDatabase({}, File("there.db"), File("new.db"), {}).status().code(),
            absl::StatusCode::kFailedPrecondition);
  CallContext stopped;
  stopped.is_cancelled = [] { return true; };
  EXPECT_EQ(RebuildDatabase(stopped, original, File("new.db"), {}).status().code(), absl::StatusCode::kCancelled);
  for (const auto& file : fs::directory_iterator(folder_)) {
    EXPECT_FALSE(file.path().filename().string().starts_with("new.db")) << file.path();
  }
}

}  // namespace
}  // namespace mapp::testing
