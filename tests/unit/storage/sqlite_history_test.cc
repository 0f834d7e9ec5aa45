// The schema's promise: whatever is written, the map at every earlier revision can still be read.
#include "mapp/base/rng.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <map>
#include <set>

namespace mapp {
namespace {

using sqlite::Connection;
using sqlite::Statement;

/// "x in_map" of each point, frame or observation list by id: enough to tell states apart.
struct State {
  std::map<uint64_t, std::string> points, frames;
  std::map<uint64_t, size_t> num_observations;
  friend bool operator==(const State&, const State&) = default;
};

std::string Describe(double x_m, bool in_map) { return fmt::format("{:.3f} {}", x_m, in_map); }

/// The state as live reads give it.
State LiveState(MapStore& store, const Scene& scene, const std::set<uint64_t>& frames) {
  State state;
  const auto reader = Value(store.Read());
  for (const PointRecord& point : Value(reader->PointsOfSession(scene.session))) {
    state.points[point.id.value()] = Describe(point.position.x(), point.in_map);
  }
  for (const uint64_t id : frames) {
    const FrameRecord frame = Value(reader->GetFrame(FrameId(id)));
    state.frames[id] = Describe(frame.T_frame_camera.translation().x(), frame.in_map);
    state.num_observations[id] = Value(reader->GetObservations(FrameId(id))).size();
  }
  return state;
}

/// The same AS OF a revision, as docs/formats/database.md says it is read.
State StateAsOf(Connection& db, Revision revision) {
  State state;
  Statement points = db.Prepare(
      "SELECT point_id, x_m, tile_id IS NOT NULL FROM points WHERE created_revision <= ?1 UNION ALL "
      "SELECT point_id, x_m, tile_id IS NOT NULL FROM point_history WHERE created_revision <= ?1 AND "
      "?1 < retired_revision");
  points.Bind(revision);
  while (Value(points.Step())) {
    const auto [position, inserted] =
        state.points.emplace(points.Int64(0), Describe(points.Double(1), points.Int64(2) != 0));
    EXPECT_TRUE(inserted) << "two versions of point " << position->first << " at revision " << revision.value();
  }
  Statement frames = db.Prepare(
      "SELECT frame_id, tx_m, in_map FROM frames WHERE pose_revision <= ?1 UNION ALL SELECT frame_id, tx_m, in_map "
      "FROM frame_pose_history WHERE created_revision <= ?1 AND ?1 < retired_revision");
  frames.Bind(revision);
  while (Value(frames.Step())) {
    EXPECT_TRUE(state.frames.emplace(frames.Int64(0), Describe(frames.Double(1), frames.Int64(2) != 0)).second);
  }
  Statement observations = db.Prepare(
      "SELECT frame_id, (length(observations) - 6) / 6 FROM frame_observations WHERE created_revision <= ?1 UNION ALL "
      "SELECT frame_id, (length(observations) - 6) / 6 FROM frame_observation_history WHERE created_revision <= ?1 "
      "AND ?1 < retired_revision");
  observations.Bind(revision);
  while (Value(observations.Step())) {
    EXPECT_TRUE(state.num_observations.emplace(observations.Int64(0), observations.Int64(1)).second);
  }
  return state;
}

/// One random change of a few operations, some on the same thing.
void ChangeAtRandom(MapWriter& writer, const Scene& scene, Rng& rng, std::set<uint64_t>* frames) {
  const auto random_x = [&rng] { return rng.Uniform(-30, 30); };
  // Small ids and indices: each observation takes 6 bytes.
  const std::vector<Observation> observations(rng.Below(5), {.feature_idx = 0, .point = MapPointId(1), .depth_m = 1});
  for (uint64_t i = 0; i < 1 + rng.Below(4); ++i) {
    const std::vector<PointRecord> points = Value(writer.PointsOfSession(scene.session));
    const uint64_t action = rng.Below(6);
    if (action == 0 || points.size() < 2 || frames->empty()) {
      Value(writer.InsertPoint(scene.map, TestPoint(scene.session, rng.Below(50), {random_x(), 0, 0}, rng.Below(2))));
      FrameRecord frame = TestFrame(scene.map, scene.session, scene.camera, static_cast<uint32_t>(frames->size()),
                                    PoseAt(random_x(), 0, 0));
      frame.in_map = rng.Below(2) != 0;
      frames->insert(Value(writer.InsertFrame(frame, "packet", observations)).value());
    } else if (action <= 2) {
      PointRecord point = points[rng.Below(points.size())];
      point.position.x() = random_x();
      point.in_map = rng.Below(2) != 0;
      Check(writer.UpdatePoint(point));
    } else if (action == 3) {
      const size_t victim = rng.Below(points.size());
      const bool fuse = rng.Below(2) != 0;
      Check(writer.RetirePoint(points[victim].id,
                               fuse ? std::optional(points[(victim + 1) % points.size()].id) : std::nullopt));
    } else {
      const FrameId frame(*std::next(frames->begin(), static_cast<std::ptrdiff_t>(rng.Below(frames->size()))));
      if (action == 4) {
        Check(writer.SetFramePose(frame, rng.Below(2) != 0, PoseAt(random_x(), 0, 0)));
      } else {
        Check(writer.SetObservations(frame, observations));
      }
    }
  }
}

TEST(SqliteHistoryTest, EveryRevisionStaysReadable) {
  constexpr int kChanges = 60;
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    const TempFolder folder;
    const std::string file = folder.File("maps.db");
    const auto store = Value(OpenSqliteMapStore(file, {.sync_commits = false}));
    Scene scene;
    std::set<uint64_t> frames;
    std::map<Revision, State> expected;
    Check(store->Write({}, [&](MapWriter& writer) {
      scene = AddScene(writer, "history");
      return absl::OkStatus();
    }));
    Rng rng(seed);
    for (int i = 0; i < kChanges; ++i) {
      Check(store->Write({}, [&](MapWriter& writer) {
        ChangeAtRandom(writer, scene, rng, &frames);
        return absl::OkStatus();
      }));
      const Revision revision = Value(Value(store->Read())->GetMap(scene.map)).revision;
      expected[revision] = LiveState(*store, scene, frames);
    }
    const auto db = Value(Connection::Open(file, Connection::Mode::kReadOnly, std::chrono::seconds(1)));
    EXPECT_EQ(expected.size(), static_cast<size_t>(kChanges));
    for (const auto& [revision, state] : expected) {
      EXPECT_TRUE(StateAsOf(*db, revision) == state) << "seed " << seed << " revision " << revision.value();
    }
    EXPECT_EQ(Value(db->QueryInt64("SELECT count(*) FROM revisions")), kChanges);
  }
}

}  // namespace
}  // namespace mapp
