// The keyframe log, frames and observations, on every engine.
#include "tests/unit/storage/store_fixture.h"

#include <limits>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::ElementsAre;

class MapStoreFramesTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    scene_ = NewScene();
  }

  FrameRecord Frame(uint32_t number, const Pose3& T_map_camera) const {
    return TestFrame(scene_.map, scene_.session, scene_.camera, number, T_map_camera);
  }
  FrameId Insert(const FrameRecord& frame, std::span<const Observation> observations = {}) {
    FrameId id;
    MustWrite(
        [&](MapWriter& writer) { id = Value(writer.InsertFrame(frame, TestBytes(frame.number, 300), observations)); });
    return id;
  }
  std::vector<FrameId> IdsInBox(const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
    std::vector<FrameId> ids;
    for (const FrameRecord& frame : Value(Read()->FramesInBox(scene_.map, Aabb(min, max)))) ids.push_back(frame.id);
    return ids;
  }

  Scene scene_;
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreFramesTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreFramesTest, FrameComesBackAsItWas) {
  FrameRecord frame = Frame(3, PoseAt(1.25, -2.5, 0.125));
  frame.partial = true;
  frame.overlap = 0.3F;
  const FrameId id = Insert(frame);

  const FrameRecord stored = Value(Read()->GetFrame(id));
  EXPECT_EQ(stored.id, id);
  EXPECT_EQ(stored.map, scene_.map);
  EXPECT_EQ(stored.session, scene_.session);
  EXPECT_EQ(stored.camera, scene_.camera);
  EXPECT_EQ(stored.number, 3U);
  EXPECT_EQ(stored.stamp_ns, frame.stamp_ns);
  EXPECT_TRUE(stored.in_map);
  EXPECT_TRUE(stored.partial);
  EXPECT_EQ(stored.overlap, 0.3F);
  EXPECT_EQ(stored.num_features, 800U);
  EXPECT_EQ(stored.num_packet_bytes, 300);
  EXPECT_EQ(stored.created, Revision(1));
  EXPECT_EQ(stored.T_frame_camera.translation(), frame.T_frame_camera.translation());
  EXPECT_TRUE(stored.T_frame_camera.Matrix().isApprox(frame.T_frame_camera.Matrix(), 1e-15));
  EXPECT_EQ(Value(Read()->GetPacket(id)), TestBytes(3, 300));
  const FrameId without_overlap = Insert(Frame(4, PoseAt(0, 0, 0)));
  EXPECT_FALSE(Value(Read()->GetFrame(without_overlap)).overlap.has_value());
}

TEST_P(MapStoreFramesTest, StoresAKeyframeOnce) {
  const FrameId id = Insert(Frame(3, PoseAt(0, 0, 0)));
  EXPECT_EQ(Value(Read()->FindFrame(scene_.session, 3)), id);
  EXPECT_EQ(Value(Read()->FindFrame(scene_.session, 4)), std::nullopt);
  EXPECT_EQ(Value(Read()->FindFrame(SessionId(77), 3)), std::nullopt);

  EXPECT_THAT(
      Write([&](MapWriter& writer) { return writer.InsertFrame(Frame(3, PoseAt(0, 0, 0)), "again", {}).status(); }),
      HasCode(StatusCode::kAlreadyExists));
  EXPECT_EQ(Value(Read()->ListFrames(scene_.map, scene_.session)).size(), 1U);
  EXPECT_EQ(Value(Read()->GetPacket(id)), TestBytes(3, 300));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(1));
}

TEST_P(MapStoreFramesTest, CountsKeyframesAndBytes) {
  FrameRecord fragment = Frame(0, PoseAt(0, 0, 0));
  fragment.in_map = false;
  Insert(fragment);
  Insert(Frame(1, PoseAt(0, 0, 0)));
  const SessionRecord session = Value(Read()->GetSession(scene_.session));
  EXPECT_EQ(session.num_keyframes, 2);
  EXPECT_EQ(session.num_upload_bytes, 600);
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_frames, 1);
}

TEST_P(MapStoreFramesTest, RefusesWhatDoesNotFit) {
  FrameRecord frame = Frame(0, PoseAt(0, 0, 0));
  const auto insert = [&] {
    return Write([&](MapWriter& writer) { return writer.InsertFrame(frame, "packet", {}).status(); });
  };
  frame.session = SessionId(77);
  EXPECT_THAT(insert(), HasCode(StatusCode::kNotFound));
  frame = Frame(0, PoseAt(0, 0, 0));
  frame.map = NewScene("garage").map;
  EXPECT_THAT(insert(), HasCode(StatusCode::kInvalidArgument));
  frame = Frame(0, PoseAt(std::numeric_limits<double>::quiet_NaN(), 0, 0));
  EXPECT_THAT(insert(), HasCode(StatusCode::kInvalidArgument));
  EXPECT_TRUE(Value(Read()->ListFrames(scene_.map, std::nullopt)).empty());
}

TEST_P(MapStoreFramesTest, ListsFramesOfAMapOrSessionById) {
  SessionRecord other = Value(Read()->GetSession(scene_.session));
  MustWrite([&](MapWriter& writer) { other.id = Value(writer.InsertSession(other)); });
  const FrameId first = Insert(Frame(5, PoseAt(0, 0, 0)));
  const FrameId second = Insert(TestFrame(scene_.map, other.id, scene_.camera, 0, PoseAt(0, 0, 0)));
  const FrameId third = Insert(Frame(2, PoseAt(0, 0, 0)));
  const auto ids = [](const std::vector<FrameRecord>& frames) {
    std::vector<FrameId> result;
    for (const FrameRecord& frame : frames) result.push_back(frame.id);
    return result;
  };
  EXPECT_THAT(ids(Value(Read()->ListFrames(scene_.map, std::nullopt))), ElementsAre(first, second, third));
  EXPECT_THAT(ids(Value(Read()->ListFrames(scene_.map, scene_.session))), ElementsAre(first, third));
  EXPECT_TRUE(Value(Read()->ListFrames(NewScene("garage").map, std::nullopt)).empty());
}

TEST_P(MapStoreFramesTest, FindsFramesInABox) {
  const FrameId inside = Insert(Frame(0, PoseAt(1, 2, 3)));
  const FrameId on_border = Insert(Frame(1, PoseAt(2, 2, 3)));
  Insert(Frame(2, PoseAt(2.000001, 2, 3)));
  FrameRecord fragment = Frame(3, PoseAt(1, 2, 3));
  fragment.in_map = false;
  Insert(fragment);
  const Scene garage = NewScene("garage");
  Insert(TestFrame(garage.map, garage.session, garage.camera, 0, PoseAt(1, 2, 3)));
  EXPECT_THAT(IdsInBox({0, 0, 0}, {2, 4, 4}), ElementsAre(inside, on_border));
  EXPECT_TRUE(Value(Read()->FramesInBox(scene_.map, Aabb())).empty());
}

TEST_P(MapStoreFramesTest, BoxIsExactFarFromTheOrigin) {
  // float32 knows steps of 6 cm here.
  const double x = 900'000.013;
  const FrameId frame = Insert(Frame(0, PoseAt(x, 0, 0)));
  EXPECT_THAT(IdsInBox({x, 0, 0}, {x, 0, 0}), ElementsAre(frame));
  EXPECT_TRUE(IdsInBox({x + 1e-6, -1, -1}, {x + 1, 1, 1}).empty());
}

TEST_P(MapStoreFramesTest, PoseMovesTheFrame) {
  const FrameId frame = Insert(Frame(0, PoseAt(1, 0, 0)));
  Check(Write([&](MapWriter& writer) { return writer.SetFramePose(frame, true, PoseAt(50, 0, 0)); }));
  EXPECT_EQ(Value(Read()->GetFrame(frame)).T_frame_camera.translation().x(), 50);
  EXPECT_EQ(Value(Read()->GetFrame(frame)).created, Revision(1));
  EXPECT_TRUE(IdsInBox({0, -1, -1}, {2, 1, 1}).empty());
  EXPECT_THAT(IdsInBox({49, -1, -1}, {51, 1, 1}), ElementsAre(frame));

  Check(Write([&](MapWriter& writer) { return writer.SetFramePose(frame, false, PoseAt(50, 0, 0)); }));
  EXPECT_TRUE(IdsInBox({49, -1, -1}, {51, 1, 1}).empty());
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_frames, 0);

  Check(Write([&](MapWriter& writer) { return writer.SetFramePose(frame, true, PoseAt(3, 0, 0)); }));
  EXPECT_THAT(IdsInBox({2, -1, -1}, {4, 1, 1}), ElementsAre(frame));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).num_frames, 1);
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(4));
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.SetFramePose(FrameId(99), true, PoseAt(0, 0, 0)); }),
              HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreFramesTest, ObservationsComeBackInOrder) {
  const std::vector<Observation> observations = {{.feature_idx = 7, .point = MapPointId(5), .depth_m = 2.5F},
                                                 {.feature_idx = 3, .point = MapPointId(1'000'000'000), .depth_m = 0},
                                                 {.feature_idx = 65535, .point = MapPointId(6), .depth_m = 0.1F}};
  const FrameId frame = Insert(Frame(0, PoseAt(0, 0, 0)), observations);
  const std::vector<Observation> stored = Value(Read()->GetObservations(frame));
  ASSERT_EQ(stored.size(), observations.size());
  for (size_t i = 0; i < stored.size(); ++i) {
    EXPECT_EQ(stored[i].feature_idx, observations[i].feature_idx);
    EXPECT_EQ(stored[i].point, observations[i].point);
    EXPECT_EQ(stored[i].depth_m, observations[i].depth_m);
  }

  Check(Write([&](MapWriter& writer) { return writer.SetObservations(frame, std::span(observations).first(1)); }));
  EXPECT_EQ(Value(Read()->GetObservations(frame)).size(), 1U);
  EXPECT_THAT(Read()->GetObservations(FrameId(99)), HasCode(StatusCode::kNotFound));
  EXPECT_THAT(Write([&](MapWriter& writer) { return writer.SetObservations(FrameId(99), {}); }),
              HasCode(StatusCode::kNotFound));
}

TEST_P(MapStoreFramesTest, FindsEverythingAfterReopening) {
  const FrameId frame = Insert(Frame(0, PoseAt(1, 2, 3)));
  Reopen();
  EXPECT_EQ(Value(Read()->GetPacket(frame)), TestBytes(0, 300));
  EXPECT_THAT(IdsInBox({0, 0, 0}, {4, 4, 4}), ElementsAre(frame));
  EXPECT_EQ(Value(Read()->GetMap(scene_.map)).revision, Revision(1));
  EXPECT_EQ(Value(Read()->GetCamera(scene_.camera)).camera.width_px, 752);
}

}  // namespace
}  // namespace mapp
