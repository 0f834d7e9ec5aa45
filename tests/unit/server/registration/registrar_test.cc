#include "server/service/registrar.h"

#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <atomic>
#include <numbers>
#include <set>

namespace mapp {
namespace {

using testing::EventLog;
using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

/// Landmark noise averages out over the hundreds of points of several keyframes.
constexpr double kMaxErrorM = 0.02;
constexpr double kMaxErrorRad = 0.5 * std::numbers::pi / 180.0;

class RegistrarTest : public ::testing::Test {
 protected:
  RegistrarTest() { StartRegistrar(); }
  ~RegistrarTest() override { registrar_->Shutdown(); }

  void StartRegistrar() {
    RegistrarOptions options;
    options.on_error = [](SessionId, const Status& status) { ADD_FAILURE() << status; };
    options.on_optimization_due = [this](SessionId session) { optimization_due_ = session; };
    registrar_ = std::make_unique<Registrar>(fixture_.store(), fixture_.tiles(), fixture_.events(), options);
  }

  /// Walks through `room` and tells the registrar of every keyframe.
  void Walk(const SyntheticRoom& room, SessionId session, const std::vector<Pose3>& poses, size_t first = 0) {
    for (size_t i = first; i < poses.size(); ++i) {
      const Keyframe keyframe =
          room.View(poses[i], poses.front(), session, static_cast<uint32_t>(i), ViewNoise(), rng_);
      const FrameId frame = fixture_.Store(session, keyframe);
      const bool in_map = fixture_.Session(session).T_map_session.has_value();
      registrar_->OnKeyframeStored(fixture_.map(), session, frame, in_map);
    }
  }

  SessionId OpenSession(bool founder, SensorKind sensor = SensorKind::kRgbd) {
    return fixture_.OpenSession(SyntheticRoom::DeviceCamera(), founder, sensor);
  }

  /// The founder has seen the whole room.
  void FoundMap() {
    founder_poses_ = SyntheticRoom::Circle(0.5, 0, 2 * std::numbers::pi / 18, 18);
    Walk(room_, OpenSession(/*founder=*/true), founder_poses_);
  }

  void ExpectAligned(SessionId session, const std::vector<Pose3>& poses) {
    const Pose3 expected = founder_poses_.front().Inverse() * poses.front();
    const SessionRecord record = fixture_.Session(session);
    ASSERT_TRUE(record.T_map_session);
    EXPECT_LT(Distance(*record.T_map_session, expected), kMaxErrorM);
    EXPECT_LT(RotationAngle(*record.T_map_session, expected), kMaxErrorRad);
  }

  MapFixture fixture_;
  std::atomic<SessionId> optimization_due_ = SessionId();  ///< told to the optimizer last
  std::unique_ptr<Registrar> registrar_;
  SyntheticRoom room_{1};
  Rng rng_{99};
  std::vector<Pose3> founder_poses_;
};

TEST_F(RegistrarTest, AlignsASecondSessionFromAnUnknownStart) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 5);
  Walk(room_, session, poses);

  const auto aligned = log.WaitFor<SessionAligned>(0);
  ASSERT_TRUE(aligned);
  EXPECT_LT(aligned->keyframe, 5U);
  ExpectAligned(session, poses);
  const auto tried = log.WaitFor<AlignmentTried>(0);
  ASSERT_TRUE(tried);
  EXPECT_EQ(tried->keyframe, 0U);
  EXPECT_GT(tried->num_candidates, 0U);
  EXPECT_GT(tried->num_inliers, 30U);
  EXPECT_EQ(tried->num_consistent, 1U);
}

TEST_F(RegistrarTest, NeverMergesAnotherPlace) {
  FoundMap();
  const SyntheticRoom elsewhere(2);
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 0, 0.3, 12);
  Walk(elsewhere, session, poses);

  ASSERT_TRUE(log.WaitFor<AlignmentTried>(poses.size() - 1));
  EXPECT_EQ(log.Count<SessionAligned>(), 0U);
  EXPECT_FALSE(fixture_.Session(session).T_map_session);
}

TEST_F(RegistrarTest, AnEqualPanelInAnotherPlaceIsNotThatPlace) {
  FoundMap();
  const SyntheticRoom elsewhere(2, room_);
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, -0.1, 0.03, 5);
  Walk(elsewhere, session, poses);

  const auto tried = log.WaitFor<AlignmentTried>(poses.size() - 1);
  ASSERT_TRUE(tried);
  EXPECT_GT(tried->num_inliers, 60U) << "the panel itself matches well";
  EXPECT_EQ(log.Count<SessionAligned>(), 0U);
  EXPECT_FALSE(fixture_.Session(session).T_map_session);
}

TEST_F(RegistrarTest, AnEqualWallIsNotThatPlaceWhenTheWayToItWasAnother) {
  FoundMap();
  const SyntheticRoom elsewhere(2, room_, -3);
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  // Turns towards the wall, and then sees nothing else.
  std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, -3.24, 0.36, 9);
  for (const double heading : {-0.1, -0.05, 0.0, 0.05, 0.1, 0.15}) {
    poses.push_back(SyntheticRoom::Stand(heading, 0.9, heading));
  }
  Walk(elsewhere, session, poses);

  const auto tried = log.WaitFor<AlignmentTried>(poses.size() - 1);
  ASSERT_TRUE(tried);
  EXPECT_GT(tried->num_inliers, 100U) << "the wall itself matches well";
  EXPECT_EQ(tried->num_consistent, 2U) << "so many would do, and those before were forgotten";
  EXPECT_EQ(log.Count<SessionAligned>(), 0U);
}

TEST_F(RegistrarTest, WaitsForKeyframesThatAgree) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  Walk(room_, session, SyntheticRoom::Circle(0.8, 1.0, 0.15, 1));

  const auto tried = log.WaitFor<AlignmentTried>(0);
  ASSERT_TRUE(tried);
  EXPECT_EQ(tried->num_consistent, 1U);
  EXPECT_FALSE(fixture_.Session(session).T_map_session);
}

TEST_F(RegistrarTest, LeavesAloneASessionWhoseOdometryContradictsTheMap) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 5);
  for (uint32_t i = 0; i < poses.size(); ++i) {
    // Odometry that jumps by half a metre from one keyframe to the next.
    const Pose3 T_world_session = poses.front() * Pose3(Eigen::Quaterniond::Identity(), {0.5 * i, 0, 0});
    const Keyframe keyframe = room_.View(poses[i], T_world_session, session, i, ViewNoise(), rng_);
    registrar_->OnKeyframeStored(fixture_.map(), session, fixture_.Store(session, keyframe), /*in_map=*/false);
  }
  ASSERT_TRUE(log.WaitFor<AlignmentTried>(poses.size() - 1));
  EXPECT_FALSE(fixture_.Session(session).T_map_session);
}

TEST_F(RegistrarTest, TriesAgainstAnEmptyMap) {
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  Walk(room_, session, SyntheticRoom::Circle(0.8, 1.0, 0.15, 1));
  const auto tried = log.WaitFor<AlignmentTried>(0);
  ASSERT_TRUE(tried);
  EXPECT_EQ(tried->num_candidates, 0U);
}

TEST_F(RegistrarTest, MergeMovesTheFragmentAndFusesItsPoints) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 5);
  const Keyframe first = room_.View(poses[0], poses[0], session, 0, ViewNoise(), rng_);
  std::vector<uint64_t> numbers;
  for (const KeyframeFeature& feature : first.features) numbers.push_back(feature.point->id);
  Walk(room_, session, poses);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));

  for (const FrameRecord& frame : fixture_.Frames(session)) {
    EXPECT_TRUE(frame.in_map);
    const Pose3 expected = founder_poses_.front().Inverse() * poses[frame.number];
    EXPECT_LT(Distance(frame.T_frame_camera, expected), kMaxErrorM) << "keyframe " << frame.number;
  }
  const auto reader = fixture_.Read();
  const auto own = reader->PointsOfSession(session);
  ASSERT_TRUE(own.ok()) << own.status();
  for (const PointRecord& point : *own) EXPECT_TRUE(point.in_map);
  // The founder saw the whole room: nearly all landmarks were known, and the session's numbers now mean its points.
  const auto found = reader->FindSessionPoints(session, numbers);
  ASSERT_TRUE(found.ok()) << found.status();
  size_t num_fused = 0;
  std::set<MapPointId> own_ids;
  for (const PointRecord& point : *own) own_ids.insert(point.id);
  for (const auto& point : *found) {
    ASSERT_TRUE(point);
    if (!own_ids.contains(*point)) ++num_fused;
  }
  EXPECT_GT(static_cast<double>(num_fused), 0.8 * static_cast<double>(numbers.size()));

  // Observations follow the fusion: no frame refers to a retired point.
  for (const FrameRecord& frame : fixture_.Frames(session)) {
    const auto observations = reader->GetObservations(frame.id);
    ASSERT_TRUE(observations.ok()) << observations.status();
    std::vector<MapPointId> ids;
    for (const Observation& observation : *observations) ids.push_back(observation.point);
    EXPECT_TRUE(reader->GetPoints(ids).ok());
    EXPECT_EQ(std::set(ids.begin(), ids.end()).size(), ids.size()) << "observed once each";
  }
}

TEST_F(RegistrarTest, FusedPointsCountTheNewObservers) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  Walk(room_, session, SyntheticRoom::Circle(0.8, 1.0, 0.15, 4));
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));

  const auto reader = fixture_.Read();
  const FrameRecord frame = fixture_.Frames(session).front();
  const auto observations = reader->GetObservations(frame.id);
  ASSERT_TRUE(observations.ok());
  size_t num_observed_by_both = 0;
  for (const Observation& observation : *observations) {
    const auto points = reader->GetPoints(std::span(&observation.point, 1));
    ASSERT_TRUE(points.ok());
    if (points->front().session != session && points->front().num_observations >= 2) ++num_observed_by_both;
  }
  EXPECT_GT(num_observed_by_both, observations->size() / 2);
}

TEST_F(RegistrarTest, RecognizesTheMapAfterARestart) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 2);
  Walk(room_, session, {poses[0]});
  ASSERT_TRUE(log.WaitFor<AlignmentTried>(0));
  ASSERT_FALSE(fixture_.Session(session).T_map_session);

  registrar_->Shutdown();
  StartRegistrar();
  // The first keyframe's word was lost with the process; it is asked again, so the second one completes the pair.
  Walk(room_, session, poses, 1);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));
  ExpectAligned(session, poses);
}

TEST_F(RegistrarTest, OptimizationIsDueWhenAllKeyframesHaveBeenLookedAt) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 1.0, 0.15, 5);
  Walk(room_, session, poses);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));
  EXPECT_EQ(optimization_due_.load(), SessionId());
  fixture_.CloseSession(session);
  registrar_->OnSessionClosed(fixture_.map(), session);
  // Taken in order: when this one is answered, what came before it is done.
  const SessionId last = OpenSession(/*founder=*/false);
  EventLog last_log(fixture_, last);
  Walk(room_, last, {poses.front()});
  ASSERT_TRUE(last_log.WaitFor<AlignmentTried>(0));
  EXPECT_EQ(optimization_due_.load(), session);
}

TEST_F(RegistrarTest, AClosedFragmentMergesOnceTheMapHasGrownToIt) {
  founder_poses_ = SyntheticRoom::Circle(0.5, 0.6, 0.3, 12);
  const SessionId founder = OpenSession(/*founder=*/true);
  Walk(room_, founder, {founder_poses_.begin(), founder_poses_.begin() + 3});

  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  const std::vector<Pose3> poses = SyntheticRoom::Circle(0.8, 3.0, 0.15, 6);
  Walk(room_, session, poses);
  ASSERT_TRUE(log.WaitFor<AlignmentTried>(poses.size() - 1));
  ASSERT_FALSE(fixture_.Session(session).T_map_session);
  fixture_.CloseSession(session);

  registrar_->Shutdown();
  StartRegistrar();  // fragments are remembered from the store
  Walk(room_, founder, founder_poses_, 3);
  ASSERT_TRUE(log.WaitFor<SessionAligned>(0));
  ExpectAligned(session, poses);
  // The first waits for the merge, the second for what that has queued.
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(registrar_->RunAlone(fixture_.Session(session).map, [] { return absl::OkStatus(); }).ok());
  }
  EXPECT_EQ(optimization_due_.load(), session) << "its optimization is owed";
}

TEST_F(RegistrarTest, AnEqualWallThatJoinsTheMapIsNotThatPlaceWhenTheWayFromItWasAnother) {
  founder_poses_ = SyntheticRoom::Circle(0.5, 1.5, 2 * std::numbers::pi / 18, 18);
  const SessionId founder = OpenSession(/*founder=*/true);
  Walk(room_, founder, {founder_poses_.begin(), founder_poses_.begin() + 10});

  const SyntheticRoom elsewhere(2, room_, -3);
  const SessionId session = OpenSession(/*founder=*/false);
  EventLog log(fixture_, session);
  // Sees nothing but the wall, and then turns away.
  std::vector<Pose3> poses;
  for (const double heading : {-0.1, -0.05, 0.0, 0.05, 0.1, 0.15}) {
    poses.push_back(SyntheticRoom::Stand(heading, 0.9, heading));
  }
  for (const Pose3& pose : SyntheticRoom::Circle(0.8, -0.36, -0.36, 9)) poses.push_back(pose);
  Walk(elsewhere, session, poses);
  ASSERT_TRUE(log.WaitFor<AlignmentTried>(poses.size() - 1));
  ASSERT_FALSE(fixture_.Session(session).T_map_session);
  fixture_.CloseSession(session);

  Walk(room_, founder, founder_poses_, 10);
  // Another session's keyframe is compared once the founder's are done with.
  const SessionId last = OpenSession(/*founder=*/false);
  EventLog last_log(fixture_, last);
  Walk(room_, last, SyntheticRoom::Circle(0.8, 1.0, 0.15, 1));
  ASSERT_TRUE(last_log.WaitFor<AlignmentTried>(0));
  EXPECT_EQ(log.Count<SessionAligned>(), 0U);
  EXPECT_FALSE(fixture_.Session(session).T_map_session);
}

TEST_F(RegistrarTest, AFragmentThatMergesBringsTheNextOne) {
  founder_poses_ = SyntheticRoom::Circle(0.5, 0.6, 0.3, 9);
  const SessionId founder = OpenSession(/*founder=*/true);
  Walk(room_, founder, {founder_poses_.begin(), founder_poses_.begin() + 3});
  const SessionId near = OpenSession(/*founder=*/false);
  const SessionId far = OpenSession(/*founder=*/false);
  EventLog near_log(fixture_, near), far_log(fixture_, far);
  const std::vector<Pose3> near_poses = SyntheticRoom::Circle(0.8, 2.9, 0.15, 9);
  const std::vector<Pose3> far_poses = SyntheticRoom::Circle(0.8, 4.0, 0.15, 6);
  Walk(room_, near, near_poses);
  Walk(room_, far, far_poses);
  ASSERT_TRUE(far_log.WaitFor<AlignmentTried>(far_poses.size() - 1));
  ASSERT_FALSE(fixture_.Session(near).T_map_session || fixture_.Session(far).T_map_session);

  Walk(room_, founder, founder_poses_, 3);
  ASSERT_TRUE(near_log.WaitFor<SessionAligned>(0));
  ASSERT_TRUE(far_log.WaitFor<SessionAligned>(0));
  ExpectAligned(near, near_poses);
  ExpectAligned(far, far_poses);
}

TEST_F(RegistrarTest, MergedFramesHelpToRecognizeLaterSessions) {
  // The founder has seen one half of the room, the second session some of it and the other half.
  founder_poses_ = SyntheticRoom::Circle(0.5, 0, 0.3, 6);
  Walk(room_, OpenSession(/*founder=*/true), founder_poses_);
  const SessionId second = OpenSession(/*founder=*/false);
  EventLog second_log(fixture_, second);
  const std::vector<Pose3> second_poses = SyntheticRoom::Circle(0.5, 1.0, 0.3, 10);
  Walk(room_, second, second_poses);
  ASSERT_TRUE(second_log.WaitFor<SessionAligned>(0));

  const SessionId third = OpenSession(/*founder=*/false);
  EventLog third_log(fixture_, third);
  const std::vector<Pose3> third_poses = SyntheticRoom::Circle(0.7, 3.0, 0.15, 4);
  Walk(room_, third, third_poses);
  ASSERT_TRUE(third_log.WaitFor<SessionAligned>(0));
  ExpectAligned(third, third_poses);
}

TEST_F(RegistrarTest, ForgetsADeletedMap) {
  FoundMap();
  const SessionId session = OpenSession(/*founder=*/false);
  const Keyframe keyframe = room_.View(founder_poses_[1], founder_poses_[1], session, 0, ViewNoise(), rng_);
  const FrameId frame = fixture_.Store(session, keyframe);
  const Status deleted =
      fixture_.store().Write({}, [this](MapWriter& writer) { return writer.DeleteMap(fixture_.map()); });
  ASSERT_TRUE(deleted.ok()) << deleted;
  // Neither is an error: the fixture's handler would fail the test.
  registrar_->OnKeyframeStored(fixture_.map(), session, frame, /*in_map=*/false);
  registrar_->OnMapDeleted(fixture_.map());
  registrar_->Shutdown();
}

}  // namespace
}  // namespace mapp
