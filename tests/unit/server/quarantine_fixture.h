#pragma once

#include "mapp/base/mutex.h"
#include "tests/unit/server/service_fixture.h"

#include <gmock/gmock.h>

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace mapp::testing {

/// What is published to one session, to be waited for.
class SessionLog {
 public:
  SessionLog(MapService& service, SessionId session) {
    auto subscription = service.WatchSession({}, session, [this](const SessionEvent& event) {
      const MutexLock lock(mutex_);
      events_.push_back(event);
      changed_.NotifyAll();
    });
    EXPECT_TRUE(subscription.ok()) << subscription.status();
    subscription_ = *std::move(subscription);
  }

  /// nullopt after half a minute without it.
  template <typename Event>
  std::optional<Event> WaitFor() {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    const MutexLock lock(mutex_);
    for (;;) {
      for (const SessionEvent& event : events_) {
        if (std::holds_alternative<Event>(event)) return std::get<Event>(event);
      }
      if (!changed_.WaitUntil(mutex_, deadline)) return std::nullopt;
    }
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  std::vector<SessionEvent> events_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<SessionEvents::Subscription> subscription_;
};

/// Turns once in the room, 0.6 m off its middle.
std::vector<Pose3> Round(int count, double first_heading = 0);

/// What is wrong with a device, done to what it should have sent.
using Corrupt = std::function<void(Keyframe&, Rng&)>;
/// As a device with a wrong baseline or depth scale has it: its way grows with its points.
Corrupt ScaleWorld(double factor);
Corrupt ScaleDepths(double factor);
void ScrambleDescriptors(Keyframe& keyframe, Rng& rng);
void GarbagePose(Keyframe& keyframe, Rng& rng);
/// The device's numbers for its points run from `first`: none that it has used before.
void NewNumbers(Keyframe& keyframe, uint64_t first);
/// A tracker that was thrown off and did not notice; it has new points from there on.
void LosesItsWay(Keyframe& keyframe, Rng& rng);
/// As pixels of a camera with a focal length of 400 instead of 525.
void WrongIntrinsics(Keyframe& keyframe, Rng& rng);

/// What a map holds, session by session.
struct MapContent {
  struct Point {
    Eigen::Vector3d position;
    OrbDescriptor descriptor;
    std::vector<FrameId> observers;
    uint32_t num_observations;
    Eigen::Vector3f view_direction;
    float reference_distance_m;
  };
  std::map<FrameId, Pose3> frames;
  std::map<FrameId, size_t> num_observations;
  std::map<MapPointId, Point> points;
};

class QuarantineTest : public ServiceFixture {
 protected:
  static constexpr int kFounderViews = 24;

  QuarantineTest() {
    founder_ = Open();
    uint32_t number = 0;
    for (const Pose3& pose : Round(kFounderViews)) MustUpload(world_, pose, founder_, number++);
  }

  std::vector<FrameRecord> Frames(SessionId session) {
    const auto reader = store_->Read();
    EXPECT_TRUE(reader.ok()) << reader.status();
    auto frames = (*reader)->ListFrames(Map().id, session);
    EXPECT_TRUE(frames.ok()) << frames.status();
    return *std::move(frames);
  }

  MapContent Content() {
    MapContent content;
    const auto reader = *store_->Read();
    const auto frames = reader->ListFrames(Map().id, std::nullopt);
    EXPECT_TRUE(frames.ok()) << frames.status();
    for (const FrameRecord& frame : *frames) {
      if (!frame.in_map) continue;
      content.frames.emplace(frame.id, frame.T_frame_camera);
      content.num_observations[frame.id] = reader->GetObservations(frame.id)->size();
    }
    const auto tiles = reader->ListTiles(Map().id, std::nullopt);
    EXPECT_TRUE(tiles.ok()) << tiles.status();
    for (const TileRecord& tile : *tiles) {
      const auto points = reader->PointsInTile(Map().id, tile.key);
      EXPECT_TRUE(points.ok()) << points.status();
      for (const PointRecord& point : *points) {
        content.points[point.id] = {point.position,         point.descriptor,     point.observers,
                                    point.num_observations, point.view_direction, point.reference_distance_m};
      }
    }
    return content;
  }

  /// `some_observers`: a point may list fewer of its observers, those that had to make room on the list for others.
  static void ExpectSame(const MapContent& before, const MapContent& after, bool some_observers = false) {
    ASSERT_EQ(before.frames.size(), after.frames.size());
    for (const auto& [id, pose] : before.frames) {
      ASSERT_TRUE(after.frames.contains(id));
      EXPECT_EQ(Distance(pose, after.frames.at(id)), 0);
      EXPECT_EQ(before.num_observations.at(id), after.num_observations.at(id));
    }
    ASSERT_EQ(before.points.size(), after.points.size());
    for (const auto& [id, point] : before.points) {
      ASSERT_TRUE(after.points.contains(id));
      const MapContent::Point& now = after.points.at(id);
      EXPECT_EQ(point.position, now.position);
      EXPECT_EQ(point.descriptor, now.descriptor);
      if (some_observers) {
        EXPECT_THAT(point.observers, ::testing::IsSupersetOf(now.observers));
        EXPECT_FALSE(now.observers.empty());
      } else {
        EXPECT_EQ(point.observers, now.observers);
      }
      EXPECT_EQ(point.num_observations, now.num_observations);
      // Running means, taken back in float precision.
      EXPECT_LT((point.view_direction - now.view_direction).norm(), 1e-4F);
      EXPECT_NEAR(point.reference_distance_m, now.reference_distance_m, 1e-4 * point.reference_distance_m);
    }
  }

  /// A session that has come to the map as honest ones do.
  SessionId OpenAligned() { return OpenAligned(world_); }
  SessionId OpenAligned(const SyntheticWorld& world) {
    const SessionId session = Open();
    SessionLog log(*service_, session);
    for (uint32_t i = 0; i < 4; ++i) {
      MustUpload(world, SyntheticWorld::Stand(0.2 * i, -0.5, 0.15 * i), session, i, kFirstPoint);
    }
    EXPECT_TRUE(log.WaitFor<SessionAligned>());
    // And the map has vouched for it since.
    MustUpload(world, SyntheticWorld::Stand(0.6, -0.4, 0.5), session, 4, kFirstPoint);
    return session;
  }

  /// Walks on with keyframes of this kind until the server takes no more; what it says then, or OK.
  Status WalkOn(SessionId session, const std::vector<Pose3>& poses, uint32_t first_number, const Corrupt& corrupt,
                const SyntheticWorld& world, const SensorNoise& noise = {}) {
    uint32_t number = first_number;
    for (const Pose3& pose : poses) {
      Keyframe keyframe = world.View(pose, session, number++, rng_, kFirstPoint, noise);
      if (corrupt) corrupt(keyframe, rng_);
      MAPP_RETURN_IF_ERROR(Upload(keyframe).status());
      Settle();
    }
    return absl::OkStatus();
  }

  /// The registrar works in order: once a fragment's keyframe has been tried, what came before is done.
  void Settle() {
    const SessionId probe = Open();
    SessionLog log(*service_, probe);
    Keyframe nothing;
    nothing.session = probe;
    EXPECT_TRUE(Upload(nothing).ok());
    EXPECT_TRUE(log.WaitFor<AlignmentTried>());
  }

  static constexpr uint64_t kFirstPoint = 50'000;
  SessionId founder_;
};

}  // namespace mapp::testing
