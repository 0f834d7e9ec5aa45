#include "mapp/base/check.h"
#include "mapp/base/rng.h"
#include "sim/gaze.h"
#include "sim/room.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace mapp::sim {
namespace {

constexpr int kNumFrames = 150;
constexpr int64_t kRateHz = 15;
constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;
constexpr int64_t kSecondsBetweenSessions = 100;
constexpr int kSmoothingFrames = 15;

/// A walk on an ellipse around the table. Angles in degrees, counter-clockwise from world x.
struct Walk {
  double start_angle_deg = 0;
  double turn_deg = 0;  ///< walked in all
  double height_m = 0;  ///< of the camera above the floor
  struct Gaze {
    double frame = 0;
    double yaw_deg = 0;  ///< direction of the optical axis
  };
  std::array<Gaze, 3> gaze;  ///< straight in between, then smoothed
};

// One corner of the room lies at 320 degrees. Session 0 sees 4 to 276 degrees of the room; session 1 looks into the
// corner at frame 105.
constexpr double kHiddenCorner_deg = 320;

Walk WalkOf(int session) {
  constexpr double c = kHiddenCorner_deg;
  if (session == 0) return {205, 300, 1.5, {{{0, c - 285}, {115, c - 75}, {149, c - 135}}}};
  if (session == 1) return {c - 35, -250, 1.42, {{{0, c - 215}, {105, c}, {149, c - 70}}}};
  Rng rng(static_cast<uint64_t>(session));
  const double yaw_deg = rng.Uniform(0, 360);
  const double direction = rng.Uniform() < 0.5 ? -1 : 1;
  return {rng.Uniform(0, 360),
          direction * rng.Uniform(150, 300),
          rng.Uniform(1.35, 1.6),
          {{{0, yaw_deg}, {110, yaw_deg + direction * 200}, {149, yaw_deg + direction * 140}}}};
}

double YawAt(const Walk& walk, double frame) {
  if (frame <= walk.gaze.front().frame) return walk.gaze.front().yaw_deg;
  for (size_t i = 1; i < walk.gaze.size(); ++i) {
    const Walk::Gaze& from = walk.gaze[i - 1];
    const Walk::Gaze& to = walk.gaze[i];
    if (frame <= to.frame) return std::lerp(from.yaw_deg, to.yaw_deg, (frame - from.frame) / (to.frame - from.frame));
  }
  return walk.gaze.back().yaw_deg;
}

double SmoothYawAt(const Walk& walk, int frame) {
  double sum_deg = 0;
  for (int i = 0; i < kSmoothingFrames; ++i) sum_deg += YawAt(walk, frame + i - kSmoothingFrames / 2);
  return sum_deg / kSmoothingFrames;
}

double Radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

/// Of something that swings with the steps: amplitude times a sine of the given period in frames.
double Swing(double amplitude, double period, int frame) {
  return amplitude * std::sin(2.0 * std::numbers::pi * frame / period);
}

Pose3 PoseAt(const Walk& walk, int frame) {
  const double angle = Radians(walk.start_angle_deg + walk.turn_deg * frame / (kNumFrames - 1));
  const Eigen::Vector3d p_world(0.95 * std::cos(angle), 0.7 * std::sin(angle), walk.height_m + Swing(0.03, 50, frame));
  const double yaw = Radians(SmoothYawAt(walk, frame));
  const double pitch_down = Radians(9.0 + Swing(7.0, 60, frame));
  const double roll = Radians(Swing(2.0, 47, frame));
  return Pose3(LookAlong(yaw, pitch_down, roll), p_world);
}

}  // namespace

std::vector<StampedPose> RoomTrajectory(int session) {
  MAPP_CHECK(session >= 0);
  const Walk walk = WalkOf(session);
  const int64_t start_ns = (int64_t{session} + 1) * kSecondsBetweenSessions * kNanosecondsPerSecond;
  std::vector<StampedPose> poses;
  for (int frame = 0; frame < kNumFrames; ++frame) {
    poses.push_back({start_ns + frame * kNanosecondsPerSecond / kRateHz, PoseAt(walk, frame)});
  }
  return poses;
}

}  // namespace mapp::sim
