// Maps, sessions and cameras, on every engine.
#include "tests/unit/storage/store_fixture.h"

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;

class MapStoreCatalogTest : public MapStoreTest {};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreCatalogTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreCatalogTest, CreatesAndFindsAMap) {
  MapRecord map;
  map.name = "garage";
  map.tile_edge_m = 4;
  map.cone_range_m = 12;
  MapId id;
  MustWrite([&](MapWriter& writer) { id = Value(writer.CreateMap(map)); });

  const MapRecord found = Value(Read()->FindMap("garage"));
  EXPECT_EQ(found.id, id);
  EXPECT_EQ(found.tile_edge_m, 4);
  EXPECT_EQ(found.cone_range_m, 12);
  EXPECT_EQ(found.revision, Revision(0));
  EXPECT_GT(found.created_ns, 0);
  EXPECT_FALSE(found.founder.has_value());
  EXPECT_EQ(found.num_frames + found.num_points + found.num_sessions, 0);
  EXPECT_EQ(Value(Read()->GetMap(id)).name, "garage");
  EXPECT_EQ(Value(Read()->ListMaps()).size(), 1U);
}

TEST_P(MapStoreCatalogTest, KeepsTimesThatItIsGiven) {
  const Scene scene = NewScene();
  MapId map;
  SessionId session;
  MustWrite([&](MapWriter& writer) {
    MapRecord made;
    made.name = "elsewhere";
    made.created_ns = 17;
    map = Value(writer.CreateMap(made));
    SessionRecord opened;
    opened.map = map;
    opened.device = "robot";
    opened.camera = scene.camera;
    opened.opened_ns = 18;
    opened.closed_ns = 19;
    session = Value(writer.InsertSession(opened));
  });
  EXPECT_EQ(Value(Read()->GetMap(map)).created_ns, 17);
  EXPECT_EQ(Value(Read()->GetSession(session)).opened_ns, 18);
  EXPECT_EQ(Value(Read()->GetSession(session)).closed_ns, 19);
}

TEST_P(MapStoreCatalogTest, KeepsTheFeatureSettingsOfAMap) {
  MapRecord map;
  map.name = "garage";
  map.features = {.descriptor_kind = "rBRIEF-256", .scale_factor = 1.1F, .num_levels = 5, .patch_size_px = 41};
  MustWrite([&](MapWriter& writer) { Value(writer.CreateMap(map)); });
  Reopen();
  const FeatureSettings stored = Value(Read()->FindMap("garage")).features;
  EXPECT_EQ(stored.descriptor_kind, "rBRIEF-256");
  EXPECT_EQ(stored.scale_factor, 1.1F);
  EXPECT_EQ(stored.num_levels, 5);
  EXPECT_EQ(stored.patch_size_px, 41);

  map.name = "attic";
  map.features.num_levels = 0;
  const Status status = Write([&](MapWriter& writer) { return writer.CreateMap(map).status(); });
  EXPECT_THAT(std::string(status.message()), HasSubstr("feature_settings.num_levels"));
}

TEST_P(MapStoreCatalogTest, RefusesANameTwice) {
  NewScene("kitchen");
  const Status status = Write([](MapWriter& writer) {
    MapRecord map;
    map.name = "kitchen";
    return writer.CreateMap(map).status();
  });
  EXPECT_THAT(status, HasCode(StatusCode::kAlreadyExists));
  EXPECT_THAT(std::string(status.message()), HasSubstr("kitchen"));
  EXPECT_EQ(Value(Read()->ListMaps()).size(), 1U);
}

TEST_P(MapStoreCatalogTest, NamesWhatIsMissing) {
  const auto reader = Read();
  EXPECT_THAT(reader->FindMap("attic"), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(std::string(reader->FindMap("attic").status().message()), HasSubstr("attic"));
  EXPECT_THAT(reader->GetMap(MapId(7)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetSession(SessionId(7)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetCamera(CameraId(7)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Write([](MapWriter& writer) { return writer.DeleteMap(MapId(7)); }), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Write([](MapWriter& writer) { return writer.SetFounder(MapId(7), SessionId(1)); }),
              HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Write([](MapWriter& writer) { return writer.NextRevision(MapId(7)).status(); }),
              HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreCatalogTest, CameraComesBackAsItWas) {
  const Scene scene = NewScene();
  const Camera camera = Value(Read()->GetCamera(scene.camera)).camera;
  EXPECT_EQ(ModelName(camera.projection), "radial-tangential");
  EXPECT_EQ(Coefficients(camera.projection), Coefficients(TestCamera().projection));
  EXPECT_EQ(camera.width_px, 752);
  EXPECT_EQ(camera.height_px, 480);
  EXPECT_EQ(camera.stereo_baseline_m, 0.11);
}

TEST_P(MapStoreCatalogTest, SessionBeginsAsAFragment) {
  const Scene scene = NewScene();
  const SessionRecord session = Value(Read()->GetSession(scene.session));
  EXPECT_EQ(session.map, scene.map);
  EXPECT_EQ(session.camera, scene.camera);
  EXPECT_EQ(session.device, "robot-7");
  EXPECT_EQ(session.sensor, SensorKind::kStereo);
  EXPECT_EQ(session.scale_map_session, 1);
  EXPECT_GT(session.opened_ns, 0);
  EXPECT_FALSE(session.closed_ns || session.T_map_session || session.aligned_at_keyframe || session.optimized);
  EXPECT_EQ(Value(Read()->GetMap(scene.map)).num_sessions, 1);
}

TEST_P(MapStoreCatalogTest, UpdatesASession) {
  const Scene scene = NewScene();
  SessionRecord session = Value(Read()->GetSession(scene.session));
  session.closed_ns = 12;
  session.T_map_session = PoseAt(1, 2, 3);
  session.scale_map_session = 2.5;
  session.aligned_at_keyframe = 4;
  session.optimized = Revision(9);
  Check(Write([&](MapWriter& writer) { return writer.UpdateSession(session); }));

  const SessionRecord stored = Value(Read()->GetSession(scene.session));
  EXPECT_EQ(stored.closed_ns, 12);
  EXPECT_EQ(stored.scale_map_session, 2.5);
  EXPECT_EQ(stored.aligned_at_keyframe, 4U);
  EXPECT_EQ(stored.optimized, Revision(9));
  ASSERT_TRUE(stored.T_map_session.has_value());
  EXPECT_TRUE(stored.T_map_session->Matrix().isApprox(PoseAt(1, 2, 3).Matrix(), 1e-15));

  session.T_map_session.reset();
  Check(Write([&](MapWriter& writer) { return writer.UpdateSession(session); }));
  EXPECT_FALSE(Value(Read()->GetSession(scene.session)).T_map_session.has_value());
}

TEST_P(MapStoreCatalogTest, KeepsWhyASessionIsQuarantinedAndThatItWasReleased) {
  const Scene scene = NewScene();
  SessionRecord session = Value(Read()->GetSession(scene.session));
  EXPECT_FALSE(session.quarantine || session.IsQuarantined());
  session.quarantine = Quarantine{.since_ns = 7, .reason = "depths of a giant", .released_ns = std::nullopt};
  Check(Write([&](MapWriter& writer) { return writer.UpdateSession(session); }));
  SessionRecord stored = Value(Read()->ListSessions(scene.map)).at(0);
  EXPECT_TRUE(stored.IsQuarantined());
  EXPECT_EQ(stored.quarantine->since_ns, 7);
  EXPECT_EQ(stored.quarantine->reason, "depths of a giant");

  stored.quarantine->released_ns = 9;
  Check(Write([&](MapWriter& writer) { return writer.UpdateSession(stored); }));
  stored = Value(Read()->GetSession(scene.session));
  EXPECT_FALSE(stored.IsQuarantined());
  ASSERT_TRUE(stored.quarantine);
  EXPECT_EQ(stored.quarantine->released_ns, 9);
}

TEST_P(MapStoreCatalogTest, ListsSessionsOfAMapOldestFirst) {
  const Scene kitchen = NewScene("kitchen");
  const Scene garage = NewScene("garage");
  SessionRecord second = Value(Read()->GetSession(kitchen.session));
  MustWrite([&](MapWriter& writer) { second.id = Value(writer.InsertSession(second)); });

  const std::vector<SessionRecord> of_kitchen = Value(Read()->ListSessions(kitchen.map));
  ASSERT_EQ(of_kitchen.size(), 2U);
  EXPECT_EQ(of_kitchen[0].id, kitchen.session);
  EXPECT_EQ(of_kitchen[1].id, second.id);
  EXPECT_EQ(Value(Read()->ListSessions(std::nullopt)).size(), 3U);
  EXPECT_EQ(Value(Read()->ListSessions(garage.map)).size(), 1U);
}

TEST_P(MapStoreCatalogTest, KeepsPlaceBlocksInTheirOrder) {
  const Scene kitchen = NewScene("kitchen");
  const Scene garage = NewScene("garage");
  EXPECT_TRUE(Value(Read()->ListPlaceBlocks(kitchen.map)).empty());
  MustWrite([&](MapWriter& writer) {
    Check(writer.AppendPlaceBlock(kitchen.map, TestBytes(1, 300)));
    Check(writer.AppendPlaceBlock(garage.map, "of the garage"));
    Check(writer.AppendPlaceBlock(kitchen.map, ""));
    EXPECT_THAT(Value(writer.ListPlaceBlocks(kitchen.map)), ElementsAre(TestBytes(1, 300), ""));
  });
  Reopen();
  Check(Write([&](MapWriter& writer) { return writer.AppendPlaceBlock(kitchen.map, "third"); }));
  EXPECT_THAT(Value(Read()->ListPlaceBlocks(kitchen.map)), ElementsAre(TestBytes(1, 300), "", "third"));
  EXPECT_EQ(Value(Read()->GetMap(kitchen.map)).revision, Revision(0));
  Check(Write([&](MapWriter& writer) { return writer.DeleteMap(kitchen.map); }));
  EXPECT_TRUE(Value(Read()->ListPlaceBlocks(kitchen.map)).empty());
  EXPECT_THAT(Value(Read()->ListPlaceBlocks(garage.map)), ElementsAre("of the garage"));
}

TEST_P(MapStoreCatalogTest, KeepsACameraThatAnotherMapUses) {
  const Scene kitchen = NewScene("kitchen");
  const Scene garage = NewScene("garage");
  CameraId unused;
  MustWrite([&](MapWriter& writer) {
    SessionRecord guest = Value(writer.GetSession(garage.session));
    guest.camera = kitchen.camera;
    Value(writer.InsertSession(guest));
    unused = Value(writer.InsertCamera(TestCamera()));
  });
  Check(Write([&](MapWriter& writer) { return writer.DeleteMap(kitchen.map); }));
  EXPECT_EQ(Value(Read()->GetCamera(kitchen.camera)).id, kitchen.camera);
  EXPECT_EQ(Value(Read()->GetCamera(unused)).id, unused) << "no session of the map had it";
  Check(Write([&](MapWriter& writer) { return writer.DeleteMap(garage.map); }));
  EXPECT_THAT(Read()->GetCamera(kitchen.camera), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreCatalogTest, ADeletedMapLeavesItsNameAndNoHistory) {
  const Scene old = NewScene("kitchen");
  MustWrite([&](MapWriter& writer) {
    Value(writer.InsertPoint(old.map, TestPoint(old.session, 1, {1, 1, 3})));
    Check(writer.PutTag(old.map, "spring", Revision(1)));
  });
  const auto before = Value(store().ReadAsOf(old.map, Revision(1)));
  Scene fresh;
  MustWrite([&](MapWriter& writer) {
    Check(writer.DeleteMap(old.map));
    EXPECT_THAT(writer.NextRevision(old.map), HasCode(StatusCode::kNotFound));
    fresh = AddScene(writer, "kitchen");
  });
  EXPECT_THAT(store().ReadAsOf(old.map, Revision(1)), HasCode(StatusCode::kNotFound));
  EXPECT_EQ(Value(Read()->FindMap("kitchen")).id, fresh.map);
  EXPECT_TRUE(Value(Read()->ListTags(fresh.map)).empty());
  EXPECT_TRUE(Value(Read()->ListRevisions(fresh.map, Revision(0), Revision(9))).empty());
  EXPECT_EQ(Value(before->GetMap(old.map)).num_points, 1) << "a reader from before stays good";
}

TEST_P(MapStoreCatalogTest, RemembersTheFounder) {
  const Scene scene = NewScene();
  Check(Write([&](MapWriter& writer) { return writer.SetFounder(scene.map, scene.session); }));
  EXPECT_EQ(Value(Read()->GetMap(scene.map)).founder, scene.session);
}

TEST_P(MapStoreCatalogTest, RemembersWhetherTheMapHasMetricScale) {
  const Scene scene = NewScene();
  EXPECT_TRUE(Value(Read()->GetMap(scene.map)).has_metric_scale);
  Check(Write([&](MapWriter& writer) { return writer.SetMetricScale(scene.map, false); }));
  EXPECT_FALSE(Value(Read()->GetMap(scene.map)).has_metric_scale);
  EXPECT_THAT(Write([](MapWriter& writer) { return writer.SetMetricScale(MapId(7), false); }),
              HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreCatalogTest, RevisionIsOneMoreForAllOfAChange) {
  const Scene scene = NewScene();
  for (uint64_t expected = 1; expected <= 3; ++expected) {
    MustWrite([&](MapWriter& writer) {
      EXPECT_EQ(Value(writer.NextRevision(scene.map)), Revision(expected));
      EXPECT_EQ(Value(writer.NextRevision(scene.map)), Revision(expected));
      EXPECT_EQ(Value(writer.GetMap(scene.map)).revision, Revision(expected));
    });
    EXPECT_EQ(Value(Read()->GetMap(scene.map)).revision, Revision(expected));
  }
}

TEST_P(MapStoreCatalogTest, DeletesAMapAndNothingElse) {
  const Scene kitchen = NewScene("kitchen");
  const Scene garage = NewScene("garage");
  FrameId kitchen_frame, garage_frame;
  const auto fill = [](MapWriter& writer, const Scene& scene) {
    const FrameId frame = Value(writer.InsertFrame(
        TestFrame(scene.map, scene.session, scene.camera, 0, PoseAt(1, 1, 1)), TestBytes(1, 500), {}));
    Value(writer.InsertPoint(scene.map, TestPoint(scene.session, 1, {1, 1, 3})));
    const MapPointId moved = Value(writer.InsertPoint(scene.map, TestPoint(scene.session, 2, {2, 1, 3})));
    Check(writer.PutTileBlob(scene.map, {0, 0, 0}, {.revision = Revision(1), .bytes = "tile"}));
    Check(writer.RetirePoint(moved, std::nullopt));
    return frame;
  };
  MustWrite([&](MapWriter& writer) {
    kitchen_frame = fill(writer, kitchen);
    garage_frame = fill(writer, garage);
  });
  Check(Write([&](MapWriter& writer) { return writer.DeleteMap(kitchen.map); }));

  const auto reader = Read();
  const Aabb everywhere(Eigen::Vector3d::Constant(-100), Eigen::Vector3d::Constant(100));
  EXPECT_THAT(reader->GetMap(kitchen.map), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetSession(kitchen.session), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetCamera(kitchen.camera), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetPacket(kitchen_frame), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetObservations(kitchen_frame), HasCode(StatusCode::kNotFound));
  EXPECT_TRUE(Value(reader->FramesInBox(kitchen.map, everywhere)).empty());
  EXPECT_TRUE(Value(reader->PointsOfSession(kitchen.session)).empty());
  EXPECT_FALSE(Value(reader->GetTileBlob(kitchen.map, {0, 0, 0})).has_value());

  EXPECT_EQ(Value(reader->GetPacket(garage_frame)), TestBytes(1, 500));
  EXPECT_EQ(Value(reader->FramesInBox(garage.map, everywhere)).size(), 1U);
  EXPECT_EQ(Value(reader->PointsInTile(garage.map, {0, 0, 0})).size(), 1U);
  EXPECT_EQ(Value(reader->ListTiles(garage.map, everywhere)).size(), 1U);
  EXPECT_TRUE(Value(reader->GetTileBlob(garage.map, {0, 0, 0})).has_value());
  EXPECT_EQ(Value(reader->GetCamera(garage.camera)).id, garage.camera);
}

TEST_P(MapStoreCatalogTest, NeverGivesAnIdTwice) {
  const Scene first = NewScene("kitchen");
  MapPointId first_point;
  FrameId first_frame;
  MustWrite([&](MapWriter& writer) {
    first_point = Value(writer.InsertPoint(first.map, TestPoint(first.session, 1, {1, 1, 3})));
    first_frame =
        Value(writer.InsertFrame(TestFrame(first.map, first.session, first.camera, 0, PoseAt(0, 0, 0)), "packet", {}));
  });
  Check(Write([&](MapWriter& writer) { return writer.DeleteMap(first.map); }));
  Reopen();
  const Scene second = NewScene("kitchen");
  EXPECT_NE(first.map, second.map);
  EXPECT_NE(first.session, second.session);
  MustWrite([&](MapWriter& writer) {
    EXPECT_NE(Value(writer.InsertPoint(second.map, TestPoint(second.session, 1, {1, 1, 3}))), first_point);
    EXPECT_NE(Value(writer.InsertFrame(TestFrame(second.map, second.session, second.camera, 0, PoseAt(0, 0, 0)),
                                       "packet", {})),
              first_frame);
  });
}

}  // namespace
}  // namespace mapp
