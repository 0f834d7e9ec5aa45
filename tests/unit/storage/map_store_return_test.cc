// A retired point comes back, on every engine.
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/store_fixture.h"

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

/// Revision 1 makes two points, revision 2 retires the first of them.
class MapStoreReturnTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
    MustWrite([&](MapWriter& writer) {
      PointRecord point = TestPoint(scene_.session, 1, {1, 1, 1});
      point.confidence = 0.5F;
      point.num_observations = 7;
      id_ = Value(writer.InsertPoint(scene_.map, point));
      other_ = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 2, {2, 2, 2})));
    });
    point_ = Get(id_);
    Check(Retire(id_, std::nullopt));
  }

  PointRecord Get(MapPointId id) { return Value(Read()->GetPoints(std::span(&id, 1))).at(0); }
  Status Retire(MapPointId id, std::optional<MapPointId> into) {
    return Write([&](MapWriter& writer) { return writer.RetirePoint(id, into); });
  }
  Status Return(const PointRecord& point) {
    return Write([&](MapWriter& writer) { return writer.ReturnPoint(point); });
  }
  static std::optional<MapPointId> Find(MapReader& reader, SessionId session, uint64_t number) {
    return Value(reader.FindSessionPoints(session, std::span(&number, 1))).at(0);
  }
  std::unique_ptr<MapReader> AsOf(uint64_t revision) { return Value(store().ReadAsOf(scene_.map, Revision(revision))); }
  int64_t PointsAsOf(uint64_t revision) { return Value(AsOf(revision)->GetMap(scene_.map)).num_points; }

  Scene scene_;
  MapPointId id_, other_;
  PointRecord point_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreReturnTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreReturnTest, LivesAgainUnderItsId) {
  PointRecord moved = point_;
  moved.position = {-1, 1, 1};
  moved.confidence = 0.25F;
  Check(Return(moved));
  Reopen();
  const PointRecord returned = Get(id_);
  EXPECT_EQ(returned.position, moved.position);
  EXPECT_EQ(returned.confidence, 0.25F);
  EXPECT_EQ(returned.num_observations, 7U);
  EXPECT_EQ(returned.descriptor, point_.descriptor);
  EXPECT_EQ(returned.session_point, 1U);
  EXPECT_EQ(returned.created, Revision(3));
  const auto reader = Read();
  EXPECT_EQ(Find(*reader, scene_.session, 1), id_);
  EXPECT_EQ(Value(reader->GetMap(scene_.map)).num_points, 2);
  EXPECT_EQ(Value(reader->GetMap(scene_.map)).revision, Revision(3));
  EXPECT_THAT(Value(reader->PointsOfSession(scene_.session)), SizeIs(2));
  const std::vector<TileRecord> tiles = Value(reader->ListTiles(scene_.map, std::nullopt));
  ASSERT_THAT(tiles, SizeIs(2));
  for (const TileRecord& tile : tiles) {
    EXPECT_EQ(tile.num_points, 1);
    EXPECT_EQ(tile.revision, tile.key == TileKey(-1, 0, 0) ? Revision(3) : Revision(2)) << tile.key.ToString();
  }
}

TEST_P(MapStoreReturnTest, ThePastIsAsItWas) {
  const std::string alive = DumpMap(*AsOf(1), scene_.map), retired = DumpMap(*AsOf(2), scene_.map);
  Check(Return(point_));
  MustWrite([&](MapWriter& writer) { Value(writer.NextRevision(scene_.map)); });
  Check(Retire(id_, std::nullopt));
  EXPECT_EQ(DumpMap(*AsOf(1), scene_.map), alive);
  EXPECT_EQ(DumpMap(*AsOf(2), scene_.map), retired);
  EXPECT_THAT((std::vector{PointsAsOf(1), PointsAsOf(2), PointsAsOf(3), PointsAsOf(4), PointsAsOf(5)}),
              ElementsAre(2, 1, 2, 2, 1));
  EXPECT_EQ(Find(*AsOf(1), scene_.session, 1), id_);
  EXPECT_EQ(Find(*AsOf(2), scene_.session, 1), std::nullopt);
  EXPECT_EQ(Find(*AsOf(3), scene_.session, 1), id_);
  EXPECT_EQ(Find(*AsOf(5), scene_.session, 1), std::nullopt);
}

TEST_P(MapStoreReturnTest, CountsAsAdded) {
  Check(Return(point_));
  const auto diff = [&](uint64_t from, uint64_t to) {
    return Value(Read()->DiffRevisions(scene_.map, Revision(from), Revision(to)));
  };
  ASSERT_THAT(diff(2, 3), SizeIs(1));
  EXPECT_EQ(diff(2, 3)[0].points_added, 1);
  EXPECT_EQ(diff(2, 3)[0].points_removed, 0);
  EXPECT_EQ(diff(1, 2)[0].points_removed, 1);
  EXPECT_THAT(diff(1, 3), IsEmpty()) << "it stands where it stood";
}

TEST_P(MapStoreReturnTest, WhatWasFusedIntoItFollows) {
  Check(Return(point_));
  Check(Retire(other_, id_));
  Check(Retire(id_, std::nullopt));
  EXPECT_EQ(Find(*Read(), scene_.session, 2), std::nullopt);
  Check(Return(point_));
  EXPECT_EQ(Find(*Read(), scene_.session, 2), id_);
  EXPECT_EQ(Find(*AsOf(5), scene_.session, 2), std::nullopt);
}

TEST_P(MapStoreReturnTest, WithinOneRevision) {
  MapPointId brief;
  MustWrite([&](MapWriter& writer) {
    brief = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 3, {3, 3, 3})));
    const PointRecord made = Value(writer.GetPoints(std::span(&brief, 1))).at(0);
    for (int i = 0; i < 2; ++i) {
      Check(writer.RetirePoint(brief, std::nullopt));
      Check(writer.ReturnPoint(made));
    }
    Check(writer.ReturnPoint(point_));
    Check(writer.RetirePoint(id_, std::nullopt));
    Check(writer.ReturnPoint(point_));
    EXPECT_EQ(Value(writer.GetMap(scene_.map)).num_points, 3);
  });
  PointRecord moved = Get(brief);
  moved.position = {4, 4, 4};
  MustWrite([&](MapWriter& writer) { Check(writer.UpdatePoint(moved)); });
  EXPECT_EQ(PointsAsOf(2), 1);
  EXPECT_EQ(PointsAsOf(3), 3);
  EXPECT_EQ(Value(AsOf(3)->GetPoints(std::span(&brief, 1))).at(0).position, Eigen::Vector3d(3, 3, 3));
  EXPECT_EQ(Get(brief).position, Eigen::Vector3d(4, 4, 4));
}

TEST_P(MapStoreReturnTest, OfAFragmentAndWithoutItsHistory) {
  MustWrite([&](MapWriter& writer) {
    while (Value(writer.DropHistory(scene_.map, Revision(2), 1000)) > 0) {
    }
  });
  point_.in_map = false;
  Check(Return(point_));
  EXPECT_FALSE(Get(id_).in_map);
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_points, 1);
  EXPECT_EQ(Find(*AsOf(2), scene_.session, 1), std::nullopt);
  EXPECT_EQ(Find(*AsOf(3), scene_.session, 1), id_);
}

TEST_P(MapStoreReturnTest, RefusesAndChangesNothing) {
  const Scene garage = NewScene("garage");
  MapPointId fused;
  MustWrite([&](MapWriter& writer) {
    fused = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 4, {1, 1, 1})));
    Value(writer.InsertPoint(garage.map, TestPoint(garage.session, 1, {1, 1, 1})));
  });
  const PointRecord of_fused = Get(fused), live = Get(other_);
  Check(Retire(fused, other_));
  const std::string before = DumpAll(*Read());
  const auto with = [&](const std::function<void(PointRecord&)>& change) {
    PointRecord point = point_;
    change(point);
    return point;
  };
  EXPECT_THAT(Return(live), HasCode(StatusCode::kAlreadyExists));
  EXPECT_THAT(Return(of_fused), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(Return(with([](PointRecord& p) { p.id = MapPointId(77); })), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Return(with([](PointRecord& p) { p.id = MapPointId(); })), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Return(with([](PointRecord& p) { p.session = SessionId(77); })), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Return(with([&](PointRecord& p) { p.session = garage.session; })), HasCode(StatusCode::kInvalidArgument))
      << "another map's session";
  EXPECT_THAT(Return(with([](PointRecord& p) { p.session_point = 9; })), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(Return(with([](PointRecord& p) { p.position.x() = 1e12; })), HasCode(StatusCode::kInvalidArgument));
  EXPECT_EQ(DumpAll(*Read()), before);
}

}  // namespace
}  // namespace mapp
