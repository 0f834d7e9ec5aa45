// A walk that is cut: the device comes to its senses where its map is of no use, goes on in a fragment of its own, and
// walks back into what it knew.

#include "eval/harness/figures.h"
#include "mapp/client/device.h"
#include "sim/sequence_writer.h"
#include "tests/e2e/service_fixture.h"
#include "tests/support/spliced_walk.h"

#include <gtest/gtest.h>

#include <map>

namespace mapp {
namespace {

/// All of the room but one corner ...
constexpr RoomStretch kKnown{.session = 0, .first = 30, .last = 135};
/// ... then looking about in that corner for longer than a tracker searches, and turning away from it.
constexpr RoomStretch kCorner{.session = 1, .first = 100, .last = 110};
constexpr RoomStretch kCornerAgain{.session = 1, .first = 110, .last = 100};
constexpr RoomStretch kBack{.session = 1, .first = 110, .last = 50};

std::unique_ptr<Sequence> CutWalk() {
  return MakeSplicedWalk({kKnown, kCorner, kCornerAgain, kCorner, kCornerAgain, kCorner, kBack});
}

constexpr double kMaxAteM = 0.03;
/// Within one fragment, after alignment with the map or from its own start.
constexpr double kMaxPoseErrorM = 0.08;

class FragmentsTest : public ServiceTest {};

TEST_F(FragmentsTest, ACutWalkIsTwoSessionsAndInTheEndOneMap) {
  const std::string walk = folder().File("walk");
  const Status written = sim::WriteSequence(*CutWalk(), walk, {});
  ASSERT_TRUE(written.ok()) << written;
  StartServer();
  const Replayed replayed = Replay(walk, "device");
  ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
  const StatusOr<Figures> report = Figures::Parse(replayed.json, "report");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->Get("fragments.0.aligned_at_keyframe"), 0) << "it founds the map";
  ASSERT_TRUE(report->Get("fragments.1.session_id")) << replayed.json;
  EXPECT_FALSE(report->Get("fragments.2.session_id")) << replayed.json;
  EXPECT_NE(report->Get("fragments.1.session_id"), report->Get("fragments.0.session_id"));
  EXPECT_EQ(report->Get("fragments.1.aligned"), 1) << "the server has known the room again";
  EXPECT_GT(report->Get("fragments.1.aligned_at_keyframe").value_or(0), 0);

  const double frames_tracked = replayed.Number("frames_tracked");
  EXPECT_GE(frames_tracked, static_cast<double>(kKnown.num_frames() + kBack.num_frames()));
  EXPECT_LT(frames_tracked, replayed.Number("frames")) << "it was lost in between";
  EXPECT_EQ(replayed.Number("frames_aligned"), frames_tracked);
  // One rigid motion fits both: they are in one frame.
  ASSERT_TRUE(JsonNumber(replayed.json, "ate_m").has_value());
  EXPECT_LE(replayed.Number("ate_m"), kMaxAteM);
  EXPECT_EQ(replayed.Number("keyframes_uploaded") + replayed.Number("keyframes_skipped"), replayed.Number("keyframes"));

  const Finished rendered = RunMapp({"render", "--server", server().address(), "--map", "place", "--out",
                                     folder().File("map.png"), "--frames", folder().File("device.frames")});
  EXPECT_EQ(rendered.exit_code, 0) << rendered.err;
}

/// Plays a walk on a device in this process.
class DevicePlayer {
 public:
  explicit DevicePlayer(std::unique_ptr<Sequence> walk) : walk_(std::move(walk)) {}

  void Open(const std::string& address) {
    OrbTrackerOptions tracker_options;
    tracker_options.synchronous = true;
    auto tracker = OrbTracker::CreateRgbd(walk_->camera(), tracker_options);
    ASSERT_TRUE(tracker.ok()) << tracker.status();
    MapClientOptions client_options;
    client_options.server_address = address;
    ParticipantOptions options;
    options.map_name = "place";
    auto device = Device::Open(*std::move(tracker), client_options, options);
    ASSERT_TRUE(device.ok()) << device.status();
    device_ = *std::move(device);
  }
  /// The next frame; what it claims is compared with the truth.
  void Step() {
    const size_t i = next_++;
    const auto frame = walk_->Read(i);
    ASSERT_TRUE(frame.ok()) << frame.status();
    const auto pose = device_->Track({frame->stamp_ns, frame->gray.View(), frame->depth_m.View(), {}});
    ASSERT_TRUE(pose.ok()) << pose.status();
    last_ = pose->tracking;
    if (last_.state != TrackingState::kTracking) {
      EXPECT_FALSE(pose->T_map_camera.has_value()) << "frame " << i;
      return;
    }
    const Pose3& T_world_camera = walk_->ground_truth()[i].T_world_camera;
    // The first pose of a fragment says where its frame `session` lies.
    const Pose3& T_world_session =
        T_world_sessions_.try_emplace(last_.fragment, T_world_camera * last_.T_session_camera.Inverse()).first->second;
    EXPECT_LT(Distance(T_world_session * last_.T_session_camera, T_world_camera), kMaxPoseErrorM) << "frame " << i;
    // The map's frame is the first session's.
    if (pose->T_map_camera) {
      EXPECT_LT(Distance(T_world_sessions_.at(0) * *pose->T_map_camera, T_world_camera), kMaxPoseErrorM)
          << "frame " << i << " of fragment " << last_.fragment;
    }
  }
  bool at_end() const { return next_ == walk_->num_frames(); }
  size_t next() const { return next_; }
  const TrackingResult& last() const { return last_; }
  Device& device() { return *device_; }

 private:
  const std::unique_ptr<Sequence> walk_;
  std::unique_ptr<Device> device_;
  size_t next_ = 0;
  TrackingResult last_;
  std::map<uint32_t, Pose3> T_world_sessions_;  // by fragment
};

TEST_F(FragmentsTest, TheServerMayBeAwayWhileTheDeviceBeginsAgain) {
  constexpr std::chrono::seconds kPatience(60);
  StartServer();
  DevicePlayer player(CutWalk());
  player.Open(server().address());
  while (player.next() < kKnown.num_frames()) player.Step();
  const Status idle = player.device().WaitIdle(kPatience);
  ASSERT_TRUE(idle.ok()) << idle;
  server().Kill();
  while (player.last().fragment == 0 && !player.at_end()) player.Step();
  ASSERT_EQ(player.last().fragment, 1U);
  for (int i = 0; i < 10; ++i) player.Step();
  EXPECT_EQ(player.last().state, TrackingState::kTracking) << "without a server the device keeps its pose";
  EXPECT_FALSE(player.device().participant().session().has_value());
  EXPECT_FALSE(player.device().participant().T_map_session().has_value());

  KillAndRestartServer();
  while (!player.at_end()) {
    player.Step();
    const Status done = player.device().WaitIdle(kPatience);
    ASSERT_TRUE(done.ok()) << done;
  }
  const Status closed = player.device().Close(kPatience, /*wait_for_optimization=*/true);
  EXPECT_TRUE(closed.ok()) << closed;
  const std::vector<DeviceFragment> fragments = player.device().fragments();
  ASSERT_EQ(fragments.size(), 2U);
  EXPECT_EQ(fragments[0].trajectory.size(), kKnown.num_frames());
  for (const DeviceFragment& fragment : fragments) {
    EXPECT_EQ(fragment.session.state, ParticipantState::kClosed);
    EXPECT_TRUE(fragment.session.T_map_session.has_value());
    EXPECT_EQ(fragment.session.stats.num_dropped, 0U);
    EXPECT_EQ(fragment.session.stats.num_rejected, 0U);
  }
  const auto in_map = player.device().TrajectoryInMap();
  ASSERT_TRUE(in_map.has_value());
  EXPECT_EQ(in_map->size(), fragments[0].trajectory.size() + fragments[1].trajectory.size());
}

}  // namespace
}  // namespace mapp
