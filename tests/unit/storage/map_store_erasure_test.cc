// A session is forgotten, on every engine.
#include "tests/unit/storage/store_fixture.h"

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

class MapStoreErasureTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
    MustWrite([&](MapWriter& writer) {
      SessionRecord other = Value(writer.GetSession(scene_.session));
      other.camera = Value(writer.InsertCamera(TestCamera()));
      other_ = Value(writer.InsertSession(other));
      other_camera_ = other.camera;
      frame_ = Value(writer.InsertFrame(Frame(scene_.session, 0), "a packet", {}));
      Value(writer.InsertFrame(Frame(other_, 0), "another's", {}));
      point_ = Value(writer.InsertPoint(scene_.map, TestPoint(scene_.session, 7, {1, 2, 3})));
      Check(writer.AppendPlaceBlock(scene_.map, "a block"));
      Check(writer.PutTileBlob(scene_.map, Key(), {Revision(1), "a tile"}));
    });
  }

  FrameRecord Frame(SessionId session, uint32_t number) const {
    return TestFrame(scene_.map, session, scene_.camera, number, PoseAt(number, 0, 0));
  }
  static TileKey Key() { return TileGrid{kDefaultTileEdgeM}.KeyOf({1, 2, 3}); }

  /// What has to go before the session may.
  void TakeOut(MapWriter& writer) const {
    Check(writer.SetFramePose(frame_, /*in_map=*/false, PoseAt(0, 0, 0)));
    Check(writer.RetirePoint(point_, std::nullopt));
  }
  void DropAll(MapWriter& writer) const {
    const Revision now = Value(writer.NextRevision(scene_.map));
    while (Value(writer.DropHistory(scene_.map, now, 1000)) > 0) {
    }
  }
  std::optional<MapPointId> Find(SessionId session, uint64_t number) {
    return Value(Read()->FindSessionPoints(session, std::span(&number, 1))).at(0);
  }

  Scene scene_;
  SessionId other_;
  CameraId other_camera_;
  FrameId frame_;
  MapPointId point_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreErasureTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreErasureTest, NothingOfItCanBeRead) {
  MustWrite([&](MapWriter& writer) {
    TakeOut(writer);
    DropAll(writer);
    Check(writer.EraseSession(scene_.session));
  });
  Reopen();
  const auto reader = Read();
  EXPECT_THAT(reader->GetSession(scene_.session), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetFrame(frame_), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(reader->GetPacket(frame_), HasCode(StatusCode::kNotFound));
  EXPECT_EQ(Value(reader->FindFrame(scene_.session, 0)), std::nullopt);
  EXPECT_THAT(Value(reader->ListSessions(scene_.map)), SizeIs(1));
  EXPECT_THAT(Value(reader->ListFrames(scene_.map, std::nullopt)), SizeIs(1));
  EXPECT_EQ(Value(reader->GetMap(scene_.map)).num_sessions, 1);
  EXPECT_THAT(Value(reader->ListPlaceBlocks(scene_.map)), IsEmpty());
  EXPECT_EQ(Value(reader->GetTileBlob(scene_.map, Key())), std::nullopt);
  EXPECT_EQ(Find(scene_.session, 7), std::nullopt);
  for (const RevisionRecord& revision : Value(reader->ListRevisions(scene_.map, Revision(0), Revision(100)))) {
    EXPECT_NE(revision.session, scene_.session);
  }
  // The other's camera was its alone, and stays; so does this one's, which the other's frame names.
  EXPECT_TRUE(reader->GetCamera(other_camera_).ok());
}

TEST_P(MapStoreErasureTest, IdsAreNotGivenAgain) {
  MustWrite([&](MapWriter& writer) {
    TakeOut(writer);
    DropAll(writer);
    Check(writer.EraseSession(scene_.session));
  });
  MustWrite([&](MapWriter& writer) {
    EXPECT_GT(Value(writer.InsertFrame(Frame(other_, 1), "p", {})), frame_);
    EXPECT_GT(Value(writer.InsertPoint(scene_.map, TestPoint(other_, 1, {0, 0, 0}))), point_);
  });
}

TEST_P(MapStoreErasureTest, RefusesWhileSomethingHoldsOn) {
  const auto erase = [&](const std::function<void(MapWriter&)>& before) {
    return Write([&](MapWriter& writer) {
      before(writer);
      return writer.EraseSession(scene_.session);
    });
  };
  EXPECT_THAT(erase([](MapWriter&) {}), HasCode(StatusCode::kFailedPrecondition)) << "a frame is in the map";
  EXPECT_THAT(erase([&](MapWriter& writer) { Check(writer.SetFramePose(frame_, false, PoseAt(0, 0, 0))); }),
              HasCode(StatusCode::kFailedPrecondition))
      << "it has a live point";
  EXPECT_THAT(erase([&](MapWriter& writer) { TakeOut(writer); }), HasCode(StatusCode::kFailedPrecondition))
      << "the past can be read";
  EXPECT_THAT(erase([&](MapWriter& writer) {
                TakeOut(writer);
                Check(writer.SetFounder(scene_.map, scene_.session));
                DropAll(writer);
              }),
              HasCode(StatusCode::kFailedPrecondition))
      << "it is the founder";
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.EraseSession(SessionId(99)); }),
              HasCode(StatusCode::kNotFound));
  EXPECT_TRUE(Read()->GetFrame(frame_).ok());
}

TEST_P(MapStoreErasureTest, AnAdoptedPointIsTheOthers) {
  const OrbDescriptor looks = TestPoint(other_, 1, {0, 0, 0}).descriptor;
  MustWrite([&](MapWriter& writer) {
    Check(writer.AdoptPoint(point_, other_, 11, looks));
    Check(writer.SetFramePose(frame_, false, PoseAt(0, 0, 0)));
    DropAll(writer);
    Check(writer.EraseSession(scene_.session));
  });
  const PointRecord point = Value(Read()->GetPoints(std::span(&point_, 1))).at(0);
  EXPECT_EQ(point.session, other_);
  EXPECT_EQ(point.session_point, 11U);
  EXPECT_EQ(point.descriptor, looks);
  EXPECT_EQ(point.position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(Find(other_, 11), point_);
  EXPECT_THAT(Value(Read()->PointsOfSession(other_)), SizeIs(1));
}

TEST_P(MapStoreErasureTest, FusionsLeadPastIt) {
  MapPointId first, last;
  MustWrite([&](MapWriter& writer) {
    first = Value(writer.InsertPoint(scene_.map, TestPoint(other_, 1, {0, 0, 0})));
    last = Value(writer.InsertPoint(scene_.map, TestPoint(other_, 2, {0, 0, 1})));
    Check(writer.RetirePoint(first, point_));
    Check(writer.RetirePoint(point_, last));
    Check(writer.SetFramePose(frame_, false, PoseAt(0, 0, 0)));
    DropAll(writer);
    Check(writer.EraseSession(scene_.session));
  });
  EXPECT_EQ(Find(other_, 1), last);
}

TEST_P(MapStoreErasureTest, RewritingKeepsAllThatIsThere) {
  Check(store().Rewrite({}));
  EXPECT_EQ(Value(Read()->GetPacket(frame_)), "a packet");
  MustWrite([&](MapWriter& writer) { Value(writer.InsertFrame(Frame(other_, 1), "p", {})); });
  Reopen();
  EXPECT_THAT(Value(Read()->ListFrames(scene_.map, std::nullopt)), SizeIs(3));
  Check(store().Close());
  EXPECT_THAT(store().Rewrite({}), HasCode(StatusCode::kUnavailable));
}

}  // namespace
}  // namespace mapp
