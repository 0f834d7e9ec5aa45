// Points and tiles, on every engine.
#include "tests/unit/storage/store_fixture.h"

#include <algorithm>
#include <limits>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::UnorderedElementsAre;

class MapStorePointsTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
  }

  MapPointId Insert(uint64_t session_point, const Eigen::Vector3d& position, bool in_map = true) {
    MapPointId id;
    MustWrite([&](MapWriter& writer) {
      id = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, session_point, position, in_map)));
    });
    return id;
  }
  PointRecord Get(MapPointId id) { return Value(Read()->GetPoints(std::span(&id, 1))).at(0); }
  void Retire(MapPointId point, std::optional<MapPointId> fused_into) {
    Check(Write([&](MapWriter& writer) { return writer.RetirePoint(point, fused_into); }));
  }
  std::vector<std::optional<MapPointId>> Find(const std::vector<uint64_t>& session_points) {
    return Value(Read()->FindSessionPoints(scene_.session, session_points));
  }
  std::vector<MapPointId> IdsInTile(const TileKey& tile) {
    std::vector<MapPointId> ids;
    for (const PointRecord& point : Value(Read()->PointsInTile(scene_.map, tile))) ids.push_back(point.id);
    return ids;
  }
  /// "x/y/z r<revision> n<points>" of each tile.
  std::vector<std::string> Tiles(const std::optional<Aabb>& box = std::nullopt) {
    std::vector<std::string> tiles;
    for (const TileRecord& tile : Value(Read()->ListTiles(scene_.map, box))) {
      tiles.push_back(tile.key.ToString() + " r" + std::to_string(tile.revision.value()) + " n" +
                      std::to_string(tile.num_points));
    }
    return tiles;
  }

  Scene scene_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStorePointsTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStorePointsTest, PointComesBackAsItWas) {
  const PointRecord expected = TestPoint(scene_.session, 42, {1.0 / 3, -2, 3});
  const PointRecord point = Get(Insert(42, expected.position));
  EXPECT_EQ(point.session, scene_.session);
  EXPECT_EQ(point.session_point, 42U);
  EXPECT_TRUE(point.in_map);
  EXPECT_EQ(point.position, expected.position);
  EXPECT_EQ(point.view_direction, expected.view_direction);
  EXPECT_EQ(point.descriptor, expected.descriptor);
  EXPECT_EQ(point.reference_distance_m, expected.reference_distance_m);
  EXPECT_EQ(point.num_observations, expected.num_observations);
  EXPECT_EQ(point.confidence, expected.confidence);
  EXPECT_EQ(point.observers, expected.observers);
  EXPECT_EQ(point.created, Revision(1));
}

TEST_P(MapStorePointsTest, RefusesWhatDoesNotFit) {
  const auto insert = [&](const PointRecord& point, MapId map) {
    return Write([&](MapWriter& writer) { return writer.InsertPoint(map, point).status(); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(insert(TestPoint(SessionId(77), 1, {0, 0, 0}), scene_.map), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(insert(TestPoint(scene_.session, 1, {0, 0, 0}), NewScene("garage").map),
              HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(insert(TestPoint(scene_.session, 1, {nan, 0, 0}), scene_.map), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(insert(TestPoint(scene_.session, 1, {nan, 0, 0}, false), scene_.map),
              HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(insert(TestPoint(scene_.session, 1, {1e9, 0, 0}), scene_.map), HasCode(StatusCode::kInvalidArgument));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 0);
}

TEST_P(MapStorePointsTest, GetWantsAllAndFindLeavesOut) {
  const MapPointId a = Insert(1, {1, 1, 1});
  const MapPointId b = Insert(2, {2, 2, 2});
  const std::vector<MapPointId> wanted = {b, MapPointId(999), a};
  EXPECT_THAT(Read()->GetPoints(wanted), HasCode(StatusCode::kNotFound));
  const std::vector<PointRecord> found = Value(Read()->FindPoints(wanted));
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, b);
  EXPECT_EQ(found[1].id, a);
}

TEST_P(MapStorePointsTest, UpdateMovesThePointAndKeepsItsCounters) {
  const MapPointId id = Insert(1, {1, 1, 1});
  PointRecord moved = Get(id);
  moved.position = {20, 1, 1};
  moved.view_direction = Eigen::Vector3f::UnitX();
  moved.descriptor = TestPoint(scene_.session, 9, {0, 0, 0}).descriptor;
  moved.num_observations = 99;
  Check(Write([&](MapWriter& writer) { return writer.UpdatePoint(moved); }));

  const PointRecord stored = Get(id);
  EXPECT_EQ(stored.position, moved.position);
  EXPECT_EQ(stored.view_direction, moved.view_direction);
  EXPECT_EQ(stored.descriptor, moved.descriptor);
  EXPECT_EQ(stored.num_observations, 2U);
  EXPECT_EQ(stored.created, Revision(2));
  EXPECT_TRUE(IdsInTile({0, 0, 0}).empty());
  EXPECT_THAT(IdsInTile({2, 0, 0}), ElementsAre(id));
  EXPECT_THAT(Tiles(), ElementsAre("2/0/0 r2 n1"));
  moved.id = MapPointId(999);
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.UpdatePoint(moved); }), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStorePointsTest, TouchChangesCountersInPlace) {
  const MapPointId id = Insert(1, {1, 1, 1});
  PointRecord touched = Get(id);
  touched.num_observations = 5;
  touched.confidence = 0.5F;
  touched.observers = {FrameId(3)};
  touched.reference_distance_m = 8;
  Check(Write([&](MapWriter& writer) { return writer.TouchPoint(touched); }));

  const PointRecord stored = Get(id);
  EXPECT_EQ(stored.num_observations, 5U);
  EXPECT_EQ(stored.confidence, 0.5F);
  EXPECT_THAT(stored.observers, ElementsAre(FrameId(3)));
  EXPECT_EQ(stored.reference_distance_m, 8);
  EXPECT_EQ(stored.position, Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(stored.created, Revision(1));
  EXPECT_THAT(Tiles(), ElementsAre("0/0/0 r2 n1"));
  touched.id = MapPointId(999);
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.TouchPoint(touched); }), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStorePointsTest, TouchOfAFragmentsPointMakesNoRevision) {
  const MapPointId id = Insert(1, {1, 1, 1}, /*in_map=*/false);
  PointRecord touched = Get(id);
  touched.num_observations = 5;
  Check(Write([&](MapWriter& writer) { return writer.TouchPoint(touched); }));
  EXPECT_EQ(Get(id).num_observations, 5U);
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(1));
}

TEST_P(MapStorePointsTest, FragmentJoinsTheMap) {
  const MapPointId id = Insert(1, {1, 1, 1}, /*in_map=*/false);
  EXPECT_FALSE(Get(id).in_map);
  EXPECT_TRUE(Tiles().empty());
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 0);
  EXPECT_EQ(Value(Read()->PointsOfSession(scene_.session)).size(), 1U);

  PointRecord aligned = Get(id);
  aligned.in_map = true;
  aligned.position = {-1, 1, 1};
  Check(Write([&](MapWriter& writer) { return writer.UpdatePoint(aligned); }));
  EXPECT_TRUE(Get(id).in_map);
  EXPECT_THAT(IdsInTile({-1, 0, 0}), ElementsAre(id));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 1);
  EXPECT_EQ(Value(Read()->PointsOfSession(scene_.session)).size(), 1U);
}

TEST_P(MapStorePointsTest, RetiredPointIsGone) {
  const MapPointId id = Insert(1, {1, 1, 1});
  Retire(id, std::nullopt);
  EXPECT_THAT(Read()->GetPoints(std::span(&id, 1)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Find({1}), ElementsAre(std::nullopt));
  EXPECT_TRUE(Tiles().empty());
  EXPECT_TRUE(Value(Read()->PointsOfSession(scene_.session)).empty());
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 0);
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.RetirePoint(id, std::nullopt); }),
              HasCode(StatusCode::kNotFound));
}

TEST_P(MapStorePointsTest, SessionPointsFollowFusion) {
  const MapPointId a = Insert(1, {1, 1, 1});
  const MapPointId b = Insert(2, {1, 1, 1});
  const MapPointId c = Insert(3, {1, 1, 1});
  Retire(a, b);
  EXPECT_THAT(Find({1, 2, 3, 4}), ElementsAre(b, b, c, std::nullopt));
  Retire(b, c);
  EXPECT_THAT(Find({1, 2, 3}), ElementsAre(c, c, c));
  Retire(c, std::nullopt);
  EXPECT_THAT(Find({1, 2, 3}), ElementsAre(std::nullopt, std::nullopt, std::nullopt));
}

TEST_P(MapStorePointsTest, FusesOnlyIntoALivingPointOfTheMap) {
  const MapPointId a = Insert(1, {1, 1, 1});
  const MapPointId b = Insert(2, {1, 1, 1});
  const Scene garage = NewScene("garage");
  MapPointId elsewhere;
  MustWrite([&](MapWriter& writer) {
    elsewhere = Value(writer.InsertPoint(garage.map, TestPoint(garage.session, 1, {1, 1, 1})));
  });
  const auto fuse = [&](MapPointId into) {
    return Write([&](MapWriter& writer) { return writer.RetirePoint(a, into); });
  };
  EXPECT_THAT(fuse(a), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(fuse(elsewhere), HasCode(StatusCode::kInvalidArgument));
  Retire(b, std::nullopt);
  EXPECT_THAT(fuse(b), HasCode(StatusCode::kNotFound));
  EXPECT_EQ(Get(a).id, a);
}

TEST_P(MapStorePointsTest, NewestPointStandsForANumberSentAgain) {
  const MapPointId first = Insert(1, {1, 1, 1});
  Retire(first, std::nullopt);
  const MapPointId second = Insert(1, {1, 1, 1});
  EXPECT_THAT(Find({1}), ElementsAre(second));
}

TEST_P(MapStorePointsTest, ChangesOfOneRevisionAddUp) {
  MapPointId kept, gone;
  MustWrite([&](MapWriter& writer) {
    kept = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 1, {1, 1, 1})));
    gone = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 2, {9, 1, 1})));
    PointRecord moved = Value(writer.GetPoints(std::span(&gone, 1))).at(0);
    moved.position = {1, 1, 1};
    Check(writer.UpdatePoint(moved));
    Check(writer.UpdatePoint(moved));
    Check(writer.RetirePoint(gone, kept));
    EXPECT_EQ(Value(writer.GetMap(scene_.map)).num_points, 1);
    EXPECT_EQ(Value(writer.ListTiles(scene_.map, std::nullopt)).size(), 1U);
  });
  EXPECT_THAT(Tiles(), ElementsAre("0/0/0 r1 n1"));
  EXPECT_THAT(Find({1, 2}), ElementsAre(kept, kept));
}

TEST_P(MapStorePointsTest, TilesCountTheirPointsAndRevisions) {
  Insert(1, {1, 1, 1});
  Insert(2, {2, 2, 2});
  Insert(3, {-1, 1, 1});
  EXPECT_THAT(Tiles(), UnorderedElementsAre("0/0/0 r2 n2", "-1/0/0 r3 n1"));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 3);
  EXPECT_TRUE(Value(Read()->PointsInTile(scene_.map, {5, 5, 5})).empty());
}

TEST_P(MapStorePointsTest, FindsTilesInABox) {
  Insert(1, {1, 1, 1});
  Insert(2, {17, 1, 1});
  Insert(3, {100, 1, 1});
  EXPECT_THAT(Tiles(Aabb(Eigen::Vector3d(5, 5, 5), Eigen::Vector3d(20, 6, 6))),
              UnorderedElementsAre("0/0/0 r1 n1", "2/0/0 r2 n1"));
  EXPECT_TRUE(Tiles(Aabb(Eigen::Vector3d(8.01, 0, 0), Eigen::Vector3d(15.99, 1, 1))).empty());
  EXPECT_TRUE(Tiles(Aabb()).empty());
  EXPECT_THAT(Read()->ListTiles(MapId(77), std::nullopt), HasCode(StatusCode::kNotFound));
}

TEST_P(MapStorePointsTest, KeepsTheNewestTileBlob) {
  Insert(1, {1, 1, 1});
  const TileKey key{0, 0, 0};
  EXPECT_EQ(Value(Read()->GetTileBlob(scene_.map, key)), std::nullopt);
  const auto put = [&](uint64_t revision, const std::string& bytes) {
    Check(Write([&](MapWriter& writer) {
      return writer.PutTileBlob(scene_.map, key, {.revision = Revision(revision), .bytes = bytes});
    }));
  };
  put(2, "two");
  put(1, "one");
  EXPECT_EQ(Value(Read()->GetTileBlob(scene_.map, key))->bytes, "two");
  put(3, TestBytes(3, 100'000));
  EXPECT_EQ(Value(Read()->GetTileBlob(scene_.map, key))->revision, Revision(3));
  EXPECT_EQ(Value(Read()->GetTileBlob(scene_.map, key))->bytes, TestBytes(3, 100'000));
  EXPECT_THAT(Tiles(), ElementsAre("0/0/0 r1 n1"));
}

TEST_P(MapStorePointsTest, TakesTheBlobOfATileWithoutPoints) {
  const TileKey key{5, -5, 0};
  Check(Write([&](MapWriter& writer) {
    return writer.PutTileBlob(scene_.map, key, {.revision = Revision(0), .bytes = "empty"});
  }));
  Check(Write([&](MapWriter& writer) {
    return writer.PutTileBlob(scene_.map, key, {.revision = Revision(0), .bytes = "empty again"});
  }));
  EXPECT_EQ(Value(Read()->GetTileBlob(scene_.map, key))->bytes, "empty again");
  EXPECT_TRUE(Tiles().empty());
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(0));
}

TEST_P(MapStorePointsTest, FindsEverythingAfterReopening) {
  const MapPointId a = Insert(1, {1, 1, 1});
  const MapPointId b = Insert(2, {1, 1, 1});
  Retire(a, b);
  Reopen();
  EXPECT_THAT(Find({1, 2}), ElementsAre(b, b));
  EXPECT_THAT(IdsInTile({0, 0, 0}), ElementsAre(b));
  EXPECT_THAT(Tiles(), ElementsAre("0/0/0 r3 n1"));
}

}  // namespace
}  // namespace mapp
