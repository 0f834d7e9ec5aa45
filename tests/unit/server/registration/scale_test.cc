// Sessions of a single camera, whose lengths are in a unit of their own, and maps that they have founded.
#include "server/service/registrar.h"
#include "server/service/session_view.h"
#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

using testing::EventLog;
using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

/// What triangulation leaves open.
constexpr ViewNoise kTriangulated{.depth_share = 0.05};

class ScaleTest : public ::testing::Test {
 protected:
  ScaleTest() {
    RegistrarOptions options;
    options.on_error = [](SessionId, const Status& status) { ADD_FAILURE() << status; };
    registrar_ = std::make_unique<Registrar>(fixture_.store(), fixture_.tiles(), fixture_.events(), options);
  }
  ~ScaleTest() override { registrar_->Shutdown(); }

  /// What a device sees whose unit of length is `unit_m` metres; 0: it measures metres.
  Keyframe View(const SyntheticRoom& room, const std::vector<Pose3>& poses, size_t number, SessionId session,
                double unit_m) {
    Keyframe keyframe = room.View(poses[number], poses.front(), session, static_cast<uint32_t>(number),
                                  unit_m > 0 ? kTriangulated : ViewNoise(), rng_);
    if (unit_m > 0) ScaleLengths(keyframe, 1 / unit_m);
    return keyframe;
  }

  void Walk(const SyntheticRoom& room, SessionId session, const std::vector<Pose3>& poses, double unit_m,
            size_t first = 0) {
    for (size_t i = first; i < poses.size(); ++i) {
      const FrameId frame = fixture_.Store(session, View(room, poses, i, session, unit_m));
      const bool in_map = fixture_.Session(session).T_map_session.has_value();
      registrar_->OnKeyframeStored(fixture_.map(), session, frame, in_map);
    }
  }

  SessionId Open(bool founder, SensorKind sensor, double scale = 1) {
    return fixture_.OpenSession(SyntheticRoom::DeviceCamera(), founder, sensor, scale);
  }

  /// A founder that has seen the whole room, a unit of the map's being `map_unit_m` metres. 0: it measures them.
  SessionId FoundMap(double unit_m, double map_unit_m) {
    founder_poses_ = SyntheticRoom::Circle(0.5, 0, 2 * std::numbers::pi / 18, 18);
    const SessionId founder = unit_m > 0 ? Open(/*founder=*/true, SensorKind::kMono, unit_m / map_unit_m)
                                         : Open(/*founder=*/true, SensorKind::kRgbd);
    Walk(room_, founder, founder_poses_, unit_m);
    return founder;
  }

  MapRecord Map() { return *fixture_.Read()->GetMap(fixture_.map()); }

  /// That the session's frames stand where they are, the map's unit being `map_unit_m` metres.
  void ExpectInPlace(SessionId session, const std::vector<Pose3>& poses, double map_unit_m, double max_error_m) {
    const SessionRecord record = fixture_.Session(session);
    ASSERT_TRUE(record.T_map_session);
    const Pose3 T_founder_world = founder_poses_.front().Inverse();
    for (const FrameRecord& frame : fixture_.Frames(session)) {
      ASSERT_TRUE(frame.in_map);
      const Pose3 expected = T_founder_world * poses[frame.number];
      EXPECT_LT((map_unit_m * frame.T_frame_camera.translation() - expected.translation()).norm(), max_error_m);
      EXPECT_LT(RotationAngle(frame.T_frame_camera, expected), 0.02);
    }
  }

  /// That the session's points lie where the room ends, the map's unit being `map_unit_m` metres.
  void ExpectPointsOnTheWalls(SessionId session, double map_unit_m) {
    const auto points = fixture_.Read()->PointsOfSession(session);
    ASSERT_TRUE(points.ok()) << points.status();
    ASSERT_GT(points->size(), 100U);
    const Pose3 T_world_founder = founder_poses_.front();
    size_t num_near = 0;
    for (const PointRecord& point : *points) {
      ASSERT_TRUE(point.in_map);
      const Eigen::Vector3d p_world = T_world_founder * (map_unit_m * point.position);
      const Eigen::Vector3d to_walls =
          Eigen::Vector3d(3, 1.5, 2.5) - p_world.cwiseAbs();  // a room of 6 x 3 x 5 m around the origin
      if (to_walls.cwiseAbs().minCoeff() < 0.4) ++num_near;
    }
    EXPECT_GT(static_cast<double>(num_near), 0.95 * static_cast<double>(points->size()));
  }

  MapFixture fixture_;
  std::unique_ptr<Registrar> registrar_;
  SyntheticRoom room_{1};
  Rng rng_{7};
  std::vector<Pose3> founder_poses_;
};

TEST_F(ScaleTest, ASingleCameraJoinsAMapInMetres) {
  FoundMap(/*unit_m=*/0, 1);
  for (const double unit_m : {0.2, 4.0}) {
    const SessionId session = Open(/*founder=*/false, SensorKind::kMono);
    EventLog log(fixture_, session);
    const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 16);
    Walk(room_, session, poses, unit_m);
    const auto aligned = log.WaitFor<SessionAligned>(0);
    ASSERT_TRUE(aligned);
    EXPECT_NEAR(aligned->scale_map_session / unit_m, 1, 0.02);
    EXPECT_EQ(fixture_.Session(session).scale_map_session, aligned->scale_map_session);
    ExpectInPlace(session, poses, 1, 0.05);
  }
  EXPECT_TRUE(Map().has_metric_scale);
}

TEST_F(ScaleTest, FurtherKeyframesCorrectPlaceAndScale) {
  FoundMap(/*unit_m=*/0, 1);
  const SessionId session = Open(/*founder=*/false, SensorKind::kMono);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 40);
  Walk(room_, session, poses, 4.0);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));
  const auto corrected = log.WaitFor<SessionCorrected>(0);
  ASSERT_TRUE(corrected);
  EXPECT_NEAR(corrected->scale_map_session / 4.0, 1, 0.01);
  registrar_->Shutdown();  // nothing is corrected any more
  ExpectInPlace(session, poses, 1, 0.03);
}

TEST_F(ScaleTest, ASingleCameraNeverMergesAnotherPlace) {
  FoundMap(/*unit_m=*/0, 1);
  const SyntheticRoom others[] = {SyntheticRoom(2), SyntheticRoom(3, room_)};
  for (const SyntheticRoom& elsewhere : others) {
    const SessionId session = Open(/*founder=*/false, SensorKind::kMono);
    EventLog log(fixture_, session);
    const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 0, 0.3, 12);
    Walk(elsewhere, session, poses, 0.5);
    ASSERT_TRUE(log.WaitFor<AlignmentTried>(poses.size() - 1));
    EXPECT_FALSE(fixture_.Session(session).T_map_session);
  }
}

TEST_F(ScaleTest, SingleCamerasMeetInAMapOfUnknownScale) {
  FoundMap(/*unit_m=*/3, /*map_unit_m=*/0.8);
  const SessionId session = Open(/*founder=*/false, SensorKind::kMono);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 16);
  Walk(room_, session, poses, 0.5);
  const auto aligned = log.WaitFor<SessionAligned>(0);
  ASSERT_TRUE(aligned);
  EXPECT_NEAR(aligned->scale_map_session, 0.5 / 0.8, 0.02);
  ExpectInPlace(session, poses, 0.8, 0.05);
  EXPECT_FALSE(Map().has_metric_scale);
}

TEST_F(ScaleTest, TheFirstSessionInMetresSetsTheScale) {
  constexpr double kMapUnitM = 0.4;
  const SessionId founder = FoundMap(/*unit_m=*/2, kMapUnitM);
  const SessionId session = Open(/*founder=*/false, SensorKind::kRgbd);
  EventLog log(fixture_, session);
  EventLog founder_log(fixture_, founder);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 16);
  Walk(room_, session, poses, 0);

  const auto aligned = log.WaitFor<SessionAligned>(0);
  ASSERT_TRUE(aligned);
  EXPECT_EQ(aligned->scale_map_session, 1);
  EXPECT_TRUE(Map().has_metric_scale);
  ExpectInPlace(session, poses, 1, 0.05);
  ExpectInPlace(founder, founder_poses_, 1, 0.05);
  ExpectPointsOnTheWalls(founder, 1);

  const auto corrected = founder_log.WaitFor<SessionCorrected>(0);
  ASSERT_TRUE(corrected);
  EXPECT_NEAR(corrected->scale_map_session, 2, 0.1);
  EXPECT_EQ(fixture_.Session(founder).scale_map_session, corrected->scale_map_session);
  const auto tiles = fixture_.Read()->ListTiles(fixture_.map(), std::nullopt);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  const auto changed = founder_log.WaitFor<TilesChanged>(0);
  ASSERT_TRUE(changed);
  for (const TileRecord& tile : *tiles) {
    EXPECT_TRUE(std::ranges::count(changed->keys, tile.key) == 1) << tile.key.ToString();
  }
}

TEST_F(ScaleTest, AFragmentOfASingleCameraFollowsTheMapToItsNewUnit) {
  FoundMap(/*unit_m=*/2, /*map_unit_m=*/0.4);
  const SessionId waiting = Open(/*founder=*/false, SensorKind::kMono);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 16);
  Walk(room_, waiting, {poses.begin(), poses.begin() + 2}, 0.5);  // too few to decide

  const SessionId metric = Open(/*founder=*/false, SensorKind::kRgbd);
  EventLog metric_log(fixture_, metric);
  Walk(room_, metric, SyntheticRoom::Circle(0.8, 3.0, 0.15, 16), 0);
  ASSERT_TRUE(metric_log.WaitFor<SessionAligned>(0));

  EventLog log(fixture_, waiting);
  Walk(room_, waiting, poses, 0.5, /*first=*/2);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));
  ASSERT_TRUE(Map().has_metric_scale);
  EXPECT_NEAR(fixture_.Session(waiting).scale_map_session, 0.5, 0.02);
}

}  // namespace
}  // namespace mapp
