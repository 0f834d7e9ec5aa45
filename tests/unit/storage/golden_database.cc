#include "tests/unit/storage/golden_database.h"

#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

namespace mapp {

std::string GoldenDatabaseFile(int schema) {
  return fmt::format("{}/tests/golden/db/schema_{:04}.db", MAPP_SOURCE_DIR, schema);
}

void WriteGoldenContent(MapStore& store) {
  Check(store.Write({}, [](MapWriter& writer) {
    const Scene scene = AddScene(writer, "golden");
    const MapPointId kept = Value(writer.InsertPoint(scene.map, TestPoint(scene.session, 1, {1, 2, 3})));
    const MapPointId fused = Value(writer.InsertPoint(scene.map, TestPoint(scene.session, 2, {9, 2, 3})));
    const std::vector<Observation> observations = {{.feature_idx = 4, .point = kept, .depth_m = 2}};
    for (uint32_t number = 0; number < 2; ++number) {
      Value(writer.InsertFrame(TestFrame(scene.map, scene.session, scene.camera, number, PoseAt(number, 0, 0)),
                               TestBytes(number, 64), observations));
    }
    MAPP_RETURN_IF_ERROR(writer.RetirePoint(fused, kept));
    return writer.PutTileBlob(scene.map, {0, 0, 0}, {.revision = Revision(1), .bytes = TestBytes(9, 64)});
  }));
  // A second revision, so that the histories are not empty.
  Check(store.Write({}, [](MapWriter& writer) {
    const MapId map = Value(writer.FindMap("golden")).id;
    const FrameRecord frame = Value(writer.ListFrames(map, std::nullopt)).at(0);
    PointRecord point = Value(writer.PointsInTile(map, {0, 0, 0})).at(0);
    point.position.x() = 1.5;
    MAPP_RETURN_IF_ERROR(writer.UpdatePoint(point));
    MAPP_RETURN_IF_ERROR(writer.SetObservations(frame.id, {}));
    return writer.SetFramePose(frame.id, true, PoseAt(0.5, 0, 0));
  }));
}

void ExpectGoldenContent(MapReader& reader) {
  const MapRecord map = Value(reader.FindMap("golden"));
  EXPECT_EQ(map.revision, Revision(2));
  EXPECT_EQ(map.num_frames, 2);
  EXPECT_EQ(map.num_points, 1);
  EXPECT_EQ(map.features.descriptor_kind, "ORB-256");
  EXPECT_EQ(map.features.scale_factor, 1.2F);
  EXPECT_EQ(map.features.num_levels, 8);
  EXPECT_EQ(map.features.patch_size_px, 31);
  const SessionRecord session = Value(reader.ListSessions(map.id)).at(0);
  EXPECT_EQ(session.device, "robot-7");
  EXPECT_EQ(session.num_keyframes, 2);
  EXPECT_EQ(Value(reader.GetCamera(session.camera)).camera.width_px, 752);

  const std::vector<FrameRecord> frames = Value(reader.ListFrames(map.id, std::nullopt));
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].T_frame_camera.translation().x(), 0.5);
  EXPECT_TRUE(Value(reader.GetObservations(frames[0].id)).empty());
  EXPECT_EQ(Value(reader.GetObservations(frames[1].id)).size(), 1U);
  EXPECT_EQ(Value(reader.GetPacket(frames[1].id)), TestBytes(1, 64));

  const std::vector<PointRecord> points = Value(reader.PointsInTile(map.id, {0, 0, 0}));
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0].position, Eigen::Vector3d(1.5, 2, 3));
  EXPECT_EQ(points[0].descriptor, TestPoint(session.id, 1, {0, 0, 0}).descriptor);
  const std::vector<uint64_t> numbers = {1, 2};
  EXPECT_THAT(Value(reader.FindSessionPoints(session.id, numbers)), testing::ElementsAre(points[0].id, points[0].id));
  EXPECT_EQ(Value(reader.GetTileBlob(map.id, {0, 0, 0}))->bytes, TestBytes(9, 64));
}

}  // namespace mapp
