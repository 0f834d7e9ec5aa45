// What every engine refuses, by which code, and that a refused call leaves nothing behind.
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/store_fixture.h"

#include <functional>
#include <limits>

namespace mapp {
namespace {

using absl::StatusCode;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Farther out than a tile's key can say.
constexpr double kOutsideOfTilingM = 1e9;

/// A map with a frame and two points, and another map with a point.
struct Content {
  Scene scene, other;
  FrameId frame;
  PointRecord point, second, elsewhere;
};

struct Refusal {
  std::string what;
  StatusCode code;
  std::function<Status(MapWriter&, const Content&)> call;
};

/// A copy of `record`, changed by `change`.
template <typename Record>
Record With(Record record, const std::function<void(Record&)>& change) {
  change(record);
  return record;
}

Status Create(MapWriter& writer, const std::function<void(MapRecord&)>& change) {
  MapRecord map;
  map.name = "new";
  return writer.CreateMap(With(map, change)).status();
}
Status Open(MapWriter& writer, const Content& content, const std::function<void(SessionRecord&)>& change) {
  return writer.InsertSession(With(Value(writer.GetSession(content.scene.session)), change)).status();
}
Status Update(MapWriter& writer, const Content& content, const std::function<void(SessionRecord&)>& change) {
  return writer.UpdateSession(With(Value(writer.GetSession(content.scene.session)), change));
}
Status Upload(MapWriter& writer, const Content& content, const std::function<void(FrameRecord&)>& change) {
  const Scene& scene = content.scene;
  const FrameRecord frame = TestFrame(scene.map, scene.session, scene.camera, 9, PoseAt(0, 0, 0));
  return writer.InsertFrame(With(frame, change), "packet", {}).status();
}
Status Insert(MapWriter& writer, const Content& content, const std::function<void(PointRecord&)>& change) {
  return writer.InsertPoint(content.scene.map, With(content.point, change)).status();
}

using W = MapWriter;
using C = Content;

std::vector<Refusal> CatalogRefusals() {
  const auto bad = StatusCode::kInvalidArgument;
  const auto missing = StatusCode::kNotFound;
  return {
      {"name taken", StatusCode::kAlreadyExists,
       [](W& w, const C&) { return Create(w, [](auto& map) { map.name = "kitchen"; }); }},
      {"tile edge 0", bad, [](W& w, const C&) { return Create(w, [](auto& map) { map.tile_edge_m = 0; }); }},
      {"tile edge infinite", bad,
       [](W& w, const C&) { return Create(w, [](auto& map) { map.tile_edge_m = kInfinity; }); }},
      {"range NaN", bad, [](W& w, const C&) { return Create(w, [](auto& map) { map.cone_range_m = kNan; }); }},
      {"no levels", bad, [](W& w, const C&) { return Create(w, [](auto& map) { map.features.num_levels = 0; }); }},
      {"delete no map", missing, [](W& w, const C&) { return w.DeleteMap(MapId(77)); }},
      {"founder of no map", missing, [](W& w, const C& c) { return w.SetFounder(MapId(77), c.scene.session); }},
      {"scale of no map", missing, [](W& w, const C&) { return w.SetMetricScale(MapId(77), true); }},
      {"revision of no map", missing, [](W& w, const C&) { return w.NextRevision(MapId(77)).status(); }},
      {"block of no map", missing, [](W& w, const C&) { return w.AppendPlaceBlock(MapId(77), "block"); }},
      {"blob of no map", missing,
       [](W& w, const C&) {
         return w.PutTileBlob(MapId(77), {0, 0, 0}, {});
       }},
      {"baseline NaN", bad,
       [](W& w, const C&) {
         return w.InsertCamera(With<Camera>(TestCamera(), [](auto& camera) { camera.stereo_baseline_m = kNan; }))
             .status();
       }},
      {"session of no map", missing,
       [](W& w, const C& c) { return Open(w, c, [](auto& session) { session.map = MapId(77); }); }},
      {"session of no camera", missing,
       [](W& w, const C& c) { return Open(w, c, [](auto& session) { session.camera = CameraId(77); }); }},
      {"session of scale 0", bad,
       [](W& w, const C& c) { return Open(w, c, [](auto& session) { session.scale_map_session = 0; }); }},
      {"no session", missing, [](W& w, const C& c) { return Update(w, c, [](auto& s) { s.id = SessionId(77); }); }},
      {"scale negative", bad, [](W& w, const C& c) { return Update(w, c, [](auto& s) { s.scale_map_session = -1; }); }},
      {"scale NaN", bad, [](W& w, const C& c) { return Update(w, c, [](auto& s) { s.scale_map_session = kNan; }); }},
      {"session's pose NaN", bad,
       [](W& w, const C& c) { return Update(w, c, [](auto& s) { s.T_map_session = PoseAt(kNan, 0, 0); }); }},
      {"cause of no map", missing,
       [](W& w, const C&) { return w.SetCause(MapId(77), RevisionCause::kLoop, std::nullopt); }},
      {"cause unknown", bad,
       [](W& w, const C& c) { return w.SetCause(c.scene.map, RevisionCause::kUnknown, std::nullopt); }},
      {"tag of no map", missing, [](W& w, const C&) { return w.PutTag(MapId(77), "spring", Revision(0)); }},
      {"tag that is a number", bad, [](W& w, const C& c) { return w.PutTag(c.scene.map, "12", Revision(0)); }},
      {"tag of no revision", StatusCode::kOutOfRange,
       [](W& w, const C& c) { return w.PutTag(c.scene.map, "spring", Revision(99)); }},
      {"no tag", missing, [](W& w, const C& c) { return w.DeleteTag(c.scene.map, "winter"); }},
  };
}

std::vector<Refusal> FrameRefusals() {
  const auto bad = StatusCode::kInvalidArgument;
  const auto missing = StatusCode::kNotFound;
  return {
      {"stored", StatusCode::kAlreadyExists,
       [](W& w, const C& c) { return Upload(w, c, [](auto& frame) { frame.number = 0; }); }},
      {"frame of no session", missing,
       [](W& w, const C& c) { return Upload(w, c, [](auto& frame) { frame.session = SessionId(77); }); }},
      {"frame of another map", bad,
       [](W& w, const C& c) { return Upload(w, c, [&c](auto& frame) { frame.map = c.other.map; }); }},
      {"pose NaN", bad,
       [](W& w, const C& c) { return Upload(w, c, [](auto& frame) { frame.T_frame_camera = PoseAt(0, kNan, 0); }); }},
      {"overlap NaN", bad,
       [](W& w, const C& c) { return Upload(w, c, [](auto& f) { f.overlap = static_cast<float>(kNan); }); }},
      {"pose of no frame", missing, [](W& w, const C&) { return w.SetFramePose(FrameId(77), true, PoseAt(0, 0, 0)); }},
      {"new pose NaN", bad, [](W& w, const C& c) { return w.SetFramePose(c.frame, true, PoseAt(kNan, 0, 0)); }},
      {"observations of no frame", missing, [](W& w, const C&) { return w.SetObservations(FrameId(77), {}); }},
  };
}

std::vector<Refusal> PointRefusals() {
  const auto bad = StatusCode::kInvalidArgument;
  const auto missing = StatusCode::kNotFound;
  const auto far = [](PointRecord& point) { point.position.y() = -kOutsideOfTilingM; };
  const auto nowhere = [](PointRecord& point) { point.position.z() = kNan; };
  const auto unsure = [](PointRecord& point) { point.confidence = static_cast<float>(kNan); };
  const auto unknown = [](PointRecord& point) { point.id = MapPointId(77); };
  return {
      {"point of no session", missing,
       [](W& w, const C& c) { return Insert(w, c, [](auto& point) { point.session = SessionId(77); }); }},
      {"point of another map", bad, [](W& w, const C& c) { return w.InsertPoint(c.other.map, c.point).status(); }},
      {"point out of tiling", bad, [far](W& w, const C& c) { return Insert(w, c, far); }},
      {"point nowhere", bad, [nowhere](W& w, const C& c) { return Insert(w, c, nowhere); }},
      {"confidence NaN", bad, [unsure](W& w, const C& c) { return Insert(w, c, unsure); }},
      {"distance infinite", bad,
       [](W& w, const C& c) {
         return Insert(w, c, [](auto& point) { point.reference_distance_m = static_cast<float>(kInfinity); });
       }},
      {"update of no point", missing,
       [unknown](W& w, const C& c) { return w.UpdatePoint(With<PointRecord>(c.point, unknown)); }},
      {"update out of tiling", bad, [far](W& w, const C& c) { return w.UpdatePoint(With<PointRecord>(c.point, far)); }},
      {"update to nowhere", bad,
       [nowhere](W& w, const C& c) { return w.UpdatePoint(With<PointRecord>(c.point, nowhere)); }},
      {"touch of no point", missing,
       [unknown](W& w, const C& c) { return w.TouchPoint(With<PointRecord>(c.point, unknown)); }},
      {"touch with NaN", bad, [unsure](W& w, const C& c) { return w.TouchPoint(With<PointRecord>(c.point, unsure)); }},
      {"no point to retire", missing, [](W& w, const C&) { return w.RetirePoint(MapPointId(77), std::nullopt); }},
      {"fusion into itself", bad, [](W& w, const C& c) { return w.RetirePoint(c.point.id, c.point.id); }},
      {"fusion into no point", missing, [](W& w, const C& c) { return w.RetirePoint(c.point.id, MapPointId(77)); }},
      {"fusion into another map", bad, [](W& w, const C& c) { return w.RetirePoint(c.point.id, c.elsewhere.id); }},
  };
}

class MapStoreRefusalsTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    MustWrite([&](MapWriter& writer) {
      content_.scene = AddScene(writer, "kitchen");
      content_.other = AddScene(writer, "garage");
      const Scene& scene = content_.scene;
      content_.frame = Value(writer.InsertFrame(TestFrame(scene.map, scene.session, scene.camera, 0, PoseAt(1, 0, 0)),
                                                TestBytes(1, 40), {}));
      content_.point = AddPoint(writer, scene, 1);
      content_.second = AddPoint(writer, scene, 2);
      content_.elsewhere = AddPoint(writer, content_.other, 1);
      Check(writer.PutTag(scene.map, "autumn", Revision(1)));
    });
  }

  static PointRecord AddPoint(MapWriter& writer, const Scene& scene, uint64_t number) {
    const MapPointId id = Value(writer.InsertPoint(scene.map, TestPoint(scene.session, number, {1, 1, 1})));
    return Value(writer.GetPoints(std::span(&id, 1))).at(0);
  }

  void ExpectRefused(const std::vector<Refusal>& refusals) {
    const std::string before = DumpAll(*Read());
    for (const Refusal& refusal : refusals) {
      SCOPED_TRACE(refusal.what);
      MustWrite([&](MapWriter& writer) {
        EXPECT_THAT(refusal.call(writer, content_), HasCode(refusal.code));
        EXPECT_EQ(DumpAll(writer), before);
      });
      EXPECT_EQ(DumpAll(*Read()), before);
    }
  }

  Content content_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreRefusalsTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreRefusalsTest, RefusedCallsOnMapsAndSessionsChangeNothing) { ExpectRefused(CatalogRefusals()); }

TEST_P(MapStoreRefusalsTest, RefusedCallsOnFramesChangeNothing) { ExpectRefused(FrameRefusals()); }

TEST_P(MapStoreRefusalsTest, RefusedCallsOnPointsChangeNothing) { ExpectRefused(PointRefusals()); }

TEST_P(MapStoreRefusalsTest, AChangeGoesOnWithoutARefusedCall) {
  MustWrite([&](MapWriter& writer) {
    EXPECT_THAT(writer.RetirePoint(content_.point.id, content_.elsewhere.id), HasCode(StatusCode::kInvalidArgument));
    Check(writer.RetirePoint(content_.point.id, content_.second.id));
  });
  const std::vector<uint64_t> numbers = {1};
  EXPECT_THAT(Value(Read()->FindSessionPoints(content_.scene.session, numbers)),
              testing::ElementsAre(content_.second.id));
}

TEST_P(MapStoreRefusalsTest, WhatIsNotThereIsNamedOrEmpty) {
  const auto reader = Read();
  const Aabb everywhere(Eigen::Vector3d::Constant(-1e6), Eigen::Vector3d::Constant(1e6));
  const std::vector<uint64_t> numbers = {1, 2};
  EXPECT_THAT(reader->GetFrame(FrameId(77)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetPacket(FrameId(77)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetObservations(FrameId(77)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->ListTiles(MapId(77), everywhere), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->ListTags(MapId(77)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->DiffRevisions(MapId(77), Revision(0), Revision(0)), HasCode(StatusCode::kNotFound));
  EXPECT_TRUE(Value(reader->ListSessions(MapId(77))).empty());
  EXPECT_TRUE(Value(reader->ListFrames(MapId(77), std::nullopt)).empty());
  EXPECT_TRUE(Value(reader->ListFrames(content_.other.map, content_.scene.session)).empty());
  EXPECT_TRUE(Value(reader->FramesInBox(MapId(77), everywhere)).empty());
  EXPECT_TRUE(Value(reader->PointsInTile(MapId(77), {0, 0, 0})).empty());
  EXPECT_TRUE(Value(reader->PointsOfSession(SessionId(77))).empty());
  EXPECT_TRUE(Value(reader->ListPlaceBlocks(MapId(77))).empty());
  EXPECT_FALSE(Value(reader->GetTileBlob(MapId(77), {0, 0, 0})).has_value());
  EXPECT_FALSE(Value(reader->FindFrame(SessionId(77), 0)).has_value());
  EXPECT_THAT(Value(reader->FindSessionPoints(SessionId(77), numbers)),
              testing::ElementsAre(std::nullopt, std::nullopt));
}

}  // namespace
}  // namespace mapp
