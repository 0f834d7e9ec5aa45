// Participants against the real service: aligned, expanding, sharing, and going on after the server was away.

#include "mapp/client/participant.h"
#include "server/changes/device_evidence.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using std::chrono::seconds;
using testing::SyntheticWorld;

constexpr seconds kPatience{30};

/// Keeps the newest shared map, as a SLAM system would.
class ScriptedAdapter final : public SlamAdapter {
 public:
  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override {
    MutexLock lock(mutex_);
    map_ = std::move(map);
  }
  void LeaveSharedMap() override {
    MutexLock lock(mutex_);
    map_ = nullptr;
  }
  std::shared_ptr<const SharedMap> map() const {
    MutexLock lock(mutex_);
    return map_;
  }

 private:
  mutable Mutex mutex_;
  std::shared_ptr<const SharedMap> map_ ABSL_GUARDED_BY(mutex_);
};

/// A device that stands where it is told and sees the world without error but for its sensors.
class TestDevice {
 public:
  TestDevice(const std::string& address, const Pose3& T_world_session, uint64_t seed)
      : T_world_session_(T_world_session), rng_(seed) {
    MapClientOptions client;
    client.server_address = address;
    ParticipantOptions options;
    options.map_name = "room";
    participant_ =
        Participant::Open(client, options, SyntheticWorld::DeviceCamera(), SensorKind::kRgbd, &adapter_).value();
  }

  Keyframe See(const SyntheticWorld& world, const Pose3& T_world_camera) {
    Keyframe keyframe = world.View(T_world_camera, SessionId(1), next_number_, rng_);
    keyframe.pose_frame = PoseFrame::kSession;
    keyframe.T_frame_camera = T_world_session_.Inverse() * T_world_camera;
    keyframe.stamp_ns = int64_t{next_number_} * 1'000'000'000;
    ++next_number_;
    return keyframe;
  }
  void HandIn(const SyntheticWorld& world, const Pose3& T_world_camera) {
    participant_->OnKeyframe(See(world, T_world_camera));
    const Status idle = participant_->WaitIdle(kPatience);
    EXPECT_TRUE(idle.ok()) << idle;
  }
  /// A frame on the present shared map that could not be localised.
  void Fail(const SyntheticWorld& world, const Pose3& T_world_camera) {
    const SharedMapFrame frame{.shared_map_number = adapter_.map()->number,
                               .num_matches = 0,
                               .localized = false,
                               .T_session_camera = T_world_session_.Inverse() * T_world_camera};
    participant_->OnSharedMapFrame(frame, [&] { return std::optional(See(world, T_world_camera)); });
    const Status idle = participant_->WaitIdle(kPatience);
    EXPECT_TRUE(idle.ok()) << idle;
  }

  /// A frame that was localised on the present shared map, with what it showed, and its stamp.
  void LocalizeIn(const SyntheticWorld& world, const Pose3& T_world_camera, int64_t stamp_ns) {
    participant_->OnSharedMapFrame({.shared_map_number = adapter_.map()->number,
                                    .num_matches = 200,
                                    .localized = true,
                                    .T_session_camera = T_world_session_.Inverse() * T_world_camera},
                                   [&] {
                                     std::optional<Keyframe> keyframe = See(world, T_world_camera);
                                     keyframe->stamp_ns = stamp_ns;
                                     return keyframe;
                                   });
    const Status idle = participant_->WaitIdle(kPatience);
    EXPECT_TRUE(idle.ok()) << idle;
  }
  /// A frame that was localised on the present shared map.
  void Localize(const Pose3& T_world_camera) {
    participant_->OnSharedMapFrame({.shared_map_number = adapter_.map()->number,
                                    .num_matches = 200,
                                    .localized = true,
                                    .T_session_camera = T_world_session_.Inverse() * T_world_camera},
                                   [] { return std::nullopt; });
  }
  /// Until it is on a shared map.
  void TurnUntilSharing(const SyntheticWorld& world);

  Participant& participant() { return *participant_; }
  const ScriptedAdapter& adapter() const { return adapter_; }

 private:
  const Pose3 T_world_session_;
  Rng rng_;
  uint32_t next_number_ = 0;
  ScriptedAdapter adapter_;
  std::unique_ptr<Participant> participant_;  // last: calls the adapter
};

/// Poses that a device turns through, almost on the spot, 20 degrees a step.
Pose3 Turn(int step) { return SyntheticWorld::Stand(0.1 * step, -1, 0.35 * step); }

void TestDevice::TurnUntilSharing(const SyntheticWorld& world) {
  for (int step = 0; step < 12 && participant_->state() != ParticipantState::kSharing; ++step) {
    HandIn(world, Turn(step));
  }
  ASSERT_EQ(participant_->state(), ParticipantState::kSharing);
}

class ParticipantRpcTest : public RpcTest {
 protected:
  /// Maps the room by a full turn and leaves.
  void MapTheRoom() {
    TestDevice founder(address(), Turn(0), 1);
    for (int step = 0; step < 12; ++step) founder.HandIn(world_, Turn(step));
    EXPECT_EQ(founder.participant().stats().aligned_at_keyframe, 0U);
    const Status closed = founder.participant().Close(kPatience, true);
    EXPECT_TRUE(closed.ok()) << closed;
  }
  /// Where a second device begins: unknown to the server.
  const Pose3 T_world_second_ = SyntheticWorld::Stand(0.3, -0.8, 0.4);
};

TEST_F(ParticipantRpcTest, TheSecondDeviceIsAlignedAndSharesTheMap) {
  MapTheRoom();
  TestDevice second(address(), T_world_second_, 2);
  for (int step = 0; step < 10 && !second.participant().T_map_session(); ++step) second.HandIn(world_, Turn(step));
  ASSERT_TRUE(second.participant().T_map_session().has_value());
  // The map's frame is the founder's session frame, which began at Turn(0).
  const Pose3 T_map_session = Turn(0).Inverse() * T_world_second_;
  EXPECT_LT(Distance(*second.participant().T_map_session(), T_map_session), 0.05);
  EXPECT_LT(RotationAngle(*second.participant().T_map_session(), T_map_session), 0.02);

  for (int step = 3; step < 8 && second.participant().state() != ParticipantState::kSharing; ++step) {
    second.HandIn(world_, Turn(step));
  }
  ASSERT_EQ(second.participant().state(), ParticipantState::kSharing);
  ASSERT_NE(second.adapter().map(), nullptr);
  EXPECT_GT(second.adapter().map()->points.size(), 200U);
  const ParticipantStats stats = second.participant().stats();
  EXPECT_LE(stats.traffic.max_query_bytes, 64U);
  EXPECT_LE(stats.traffic.max_response_bytes, 200U);
}

TEST_F(ParticipantRpcTest, ADeviceThatCannotLocalizeWhereNothingChangedGoesBackToExpanding) {
  MapTheRoom();
  TestDevice second(address(), T_world_second_, 2);
  for (int step = 0; step < 12 && second.participant().state() != ParticipantState::kSharing; ++step) {
    second.HandIn(world_, Turn(step));
  }
  ASSERT_EQ(second.participant().state(), ParticipantState::kSharing);
  const uint64_t uploads = second.participant().stats().num_uploaded;
  for (int i = 0; i < 3; ++i) second.Fail(world_, Turn(3));
  EXPECT_EQ(second.participant().state(), ParticipantState::kExpanding);
  EXPECT_EQ(second.adapter().map(), nullptr);
  EXPECT_EQ(second.participant().stats().num_update_reports, 1U);
  EXPECT_EQ(second.participant().stats().num_uploaded, uploads) << "the map agrees: nothing to prove";
}

TEST_F(ParticipantRpcTest, ADeviceThatSeesAChangedWorldUploadsEvidence) {
  MapTheRoom();
  TestDevice second(address(), T_world_second_, 2);
  for (int step = 0; step < 12 && second.participant().state() != ParticipantState::kSharing; ++step) {
    second.HandIn(world_, Turn(step));
  }
  ASSERT_EQ(second.participant().state(), ParticipantState::kSharing);
  const uint64_t uploads = second.participant().stats().num_uploaded;
  const SyntheticWorld changed = world_.WithoutCabinet();
  for (int i = 0; i < 3; ++i) second.Fail(changed, Turn(0));
  EXPECT_EQ(second.participant().state(), ParticipantState::kExpanding);
  EXPECT_EQ(second.participant().stats().num_update_reports, 1U);
  EXPECT_EQ(second.participant().stats().num_uploaded, uploads + 1);
}

TEST_F(ParticipantRpcTest, AFurtherSharedMapServesWhoLocalizesOnIt) {
  MapTheRoom();
  TestDevice second(address(), T_world_second_, 2);
  second.TurnUntilSharing(world_);
  const uint32_t number = second.adapter().map()->number;
  second.Fail(world_, Turn(4));
  second.Fail(world_, Turn(4));
  EXPECT_EQ(second.adapter().map()->number, number + 2);
  second.Localize(Turn(4));
  EXPECT_EQ(second.participant().state(), ParticipantState::kSharing);
  EXPECT_EQ(second.participant().stats().num_update_reports, 0U);
  second.Fail(world_, Turn(5));
  EXPECT_EQ(second.adapter().map()->number, number + 3) << "all tries anew";
}

TEST_F(ParticipantRpcTest, WhatADeviceSeesAndMissesIsStoredThoughItUploadsNothing) {
  constexpr int64_t kMinuteNs = 60'000'000'000;
  MapTheRoom();
  const auto device = std::make_unique<TestDevice>(address(), T_world_second_, 2);
  device->TurnUntilSharing(world_);
  const SessionId session = *device->participant().session();
  const auto evidence = [&] { return FindingsOfEvidence(**store_->Read(), session).value(); };
  const uint64_t uploads = device->participant().stats().num_uploaded;
  const SyntheticWorld emptied = world_.WithoutCabinet();
  for (int i = 0; i < 4; ++i) device->LocalizeIn(emptied, SyntheticWorld::Stand(0.3 * i, -2, 0.7 * (i % 2)), i);
  EXPECT_TRUE(evidence().empty()) << "before a minute is over";
  device->LocalizeIn(emptied, SyntheticWorld::Stand(0, -2, 0), kMinuteNs + 10);
  const std::vector<PointFinding> after_a_minute = evidence();
  ASSERT_FALSE(after_a_minute.empty());
  // What a server that goes away has acknowledged it has, and the rest comes before the session closes.
  RestartServer();
  EXPECT_EQ(evidence(), after_a_minute);
  ASSERT_TRUE(device->participant().Close(kPatience, /*wait_for_optimization=*/false).ok());
  EXPECT_EQ(store_->Read().value()->ListEvidence(session)->size(), 2U);
  EXPECT_EQ(device->participant().stats().num_uploaded, uploads);

  // The map's frame is the founder's first. The cabinet's feet are left out: where they stood the floor is seen.
  const Aabb cabinet_world(Eigen::Vector3d(-0.7, -0.3, 2.5), Eigen::Vector3d(0.7, 1.2, 3.1));
  int num_missed = 0, num_seen = 0, num_missed_elsewhere = 0, num_seen_elsewhere = 0;
  for (const PointFinding& finding : evidence()) {
    const std::vector<PointRecord> point = store_->Read().value()->FindPoints({&finding.point, 1}).value();
    if (point.empty()) continue;
    const bool in_cabinet = cabinet_world.contains(Turn(0) * point[0].position);
    const bool is_missed = finding.num_missed > finding.num_seen;
    ++(in_cabinet ? is_missed ? num_missed : num_seen : is_missed ? num_missed_elsewhere : num_seen_elsewhere);
  }
  EXPECT_GT(num_missed, 2);
  EXPECT_LT(num_seen, num_missed);
  EXPECT_GT(num_seen_elsewhere, 5);
  EXPECT_LE(num_missed_elsewhere, num_seen_elsewhere / 5) << "the feet are there";
}

TEST_F(ParticipantRpcTest, WhereTheMapIsEmptyADeviceExpandsIt) {
  MapTheRoom();
  TestDevice second(address(), T_world_second_, 2);
  second.TurnUntilSharing(world_);
  const uint64_t uploads = second.participant().stats().num_uploaded;
  second.Fail(world_, SyntheticWorld::Stand(0, 60, 0));
  EXPECT_EQ(second.participant().state(), ParticipantState::kExpanding);
  EXPECT_EQ(second.adapter().map(), nullptr);
  EXPECT_EQ(second.participant().stats().num_update_reports, 0U);
  EXPECT_EQ(second.participant().stats().num_uploaded, uploads);
}

TEST_F(ParticipantRpcTest, UploadsSentTwiceAreStoredOnce) {
  const SessionId session = Open();
  const Keyframe keyframe = View(Turn(0), Turn(0), session, 0);
  v1::UploadPartialKeyframeResponse first;
  v1::UploadPartialKeyframeResponse again;
  ASSERT_TRUE(Upload(keyframe, first).ok());
  ASSERT_TRUE(Upload(keyframe, again).ok());
  EXPECT_FALSE(first.already_stored());
  EXPECT_TRUE(again.already_stored());
  EXPECT_EQ(again.frame_id(), first.frame_id());
  EXPECT_EQ(GetMap().num_frames(), 1U);
}

TEST_F(ParticipantRpcTest, TheSessionGoesOnAfterTheServerWasAway) {
  TestDevice device(address(), Turn(0), 1);
  device.HandIn(world_, Turn(0));
  RestartServer();
  device.HandIn(world_, Turn(4));
  device.HandIn(world_, Turn(8));
  EXPECT_EQ(GetMap().num_frames(), 3U);
  EXPECT_EQ(device.participant().stats().num_uploaded, 3U);
  const Status closed = device.participant().Close(kPatience, true);
  EXPECT_TRUE(closed.ok()) << closed;
}

}  // namespace
}  // namespace mapp
