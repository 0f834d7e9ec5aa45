#include "sim/world/imu.h"

#include "sim/gaze.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace mapp::sim {
namespace {

constexpr ImuNoise kExact{0, 0, 0, 0, 0, 0};

/// Ten seconds of a lively motion, a pose every 50 ms.
std::vector<StampedPose> LivelyPoses() {
  std::vector<StampedPose> poses;
  for (int i = 0; i <= 200; ++i) {
    const double t = 0.05 * i;
    const Eigen::Vector3d p_world(2 * std::sin(0.8 * t), 1.5 * std::cos(0.5 * t), 1 + 0.3 * std::sin(1.7 * t));
    poses.push_back({1'000'000'000 + int64_t{i} * 50'000'000,
                     Pose3(LookAlong(0.9 * std::sin(0.7 * t) + 0.4 * t, 0.3 * std::sin(1.1 * t), 0.2 * t), p_world)});
  }
  return poses;
}

MotionSpline Spline(const std::vector<StampedPose>& poses) {
  auto spline = MotionSpline::Through(poses);
  EXPECT_TRUE(spline.ok()) << spline.status();
  return std::move(spline).value();
}

TEST(MotionSplineTest, PassesThroughThePoses) {
  const auto poses = LivelyPoses();
  const MotionSpline motion = Spline(poses);
  for (const StampedPose& pose : poses) {
    const Pose3 T_world_body = motion.At(pose.stamp_ns).T_world_body;
    EXPECT_LT(Distance(T_world_body, pose.T_world_camera), 1e-9);
    EXPECT_LT(RotationAngle(T_world_body, pose.T_world_camera), 1e-7);
  }
}

TEST(MotionSplineTest, DerivativesAreThoseOfTheMotion) {
  const MotionSpline motion = Spline(LivelyPoses());
  constexpr int64_t kStepNs = 100'000;
  constexpr double kStep_s = 1e-4;
  for (int64_t stamp_ns = 1'500'000'000; stamp_ns < 10'500'000'000; stamp_ns += 371'000'000) {
    const MotionState before = motion.At(stamp_ns - kStepNs);
    const MotionState now = motion.At(stamp_ns);
    const MotionState after = motion.At(stamp_ns + kStepNs);
    const Eigen::Vector3d v = (after.T_world_body.translation() - before.T_world_body.translation()) / (2 * kStep_s);
    const Eigen::Vector3d a = (after.v_world - before.v_world) / (2 * kStep_s);
    const Eigen::Vector3d omega =
        LogSo3(before.T_world_body.rotation().conjugate() * after.T_world_body.rotation()) / (2 * kStep_s);
    EXPECT_LT((v - now.v_world).norm(), 1e-6);
    EXPECT_LT((a - now.a_world).norm(), 1e-2);
    EXPECT_LT((omega - now.angular_velocity_body).norm(), 1e-5);
  }
}

TEST(MotionSplineTest, RefusesTimesThatDoNotIncrease) {
  auto poses = LivelyPoses();
  poses[7].stamp_ns = poses[6].stamp_ns;
  const Status status = MotionSpline::Through(poses).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("1.300000 s"));
  EXPECT_EQ(MotionSpline::Through({}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ImuTest, WithoutNoiseItIntegratesBackToTheMotion) {
  const MotionSpline motion = Spline(LivelyPoses());
  const auto samples = ReadImu(motion, 200, kExact, 1);
  ASSERT_GE(samples.back().stamp_ns, motion.end_ns());
  MotionState state = motion.At(motion.start_ns());
  for (size_t i = 1; i < samples.size(); ++i) {
    const double dt = static_cast<double>(samples[i].stamp_ns - samples[i - 1].stamp_ns) * 1e-9;
    const auto middle = [&](auto member) { return Eigen::Vector3d((samples[i - 1].*member + samples[i].*member) / 2); };
    const Eigen::Quaterniond& R = state.T_world_body.rotation();
    const Eigen::Vector3d turn = middle(&ImuSample::angular_velocity_body) * dt;
    const Eigen::Vector3d a_world =
        R * ExpSo3(turn / 2) * middle(&ImuSample::acceleration_body) - Eigen::Vector3d(0, 0, kGravity_m_s2);
    const Eigen::Vector3d p_world = state.T_world_body.translation() + state.v_world * dt + a_world * (dt * dt / 2);
    state.v_world += a_world * dt;
    state.T_world_body = Pose3(R * ExpSo3(turn), p_world);
    const Pose3 truth = motion.At(samples[i].stamp_ns).T_world_body;
    ASSERT_LT(Distance(state.T_world_body, truth), 0.01) << "sample " << i;
    ASSERT_LT(RotationAngle(state.T_world_body, truth), 1e-3) << "sample " << i;
  }
}

TEST(ImuTest, AtRestItFeelsGravityUpwards) {
  std::vector<StampedPose> poses;
  const Pose3 T_world_body(LookAlong(0.3, 0, 0), {1, 2, 3});  // y of the body points down
  for (int i = 0; i < 100; ++i) poses.push_back({int64_t{i} * 100'000'000, T_world_body});
  const auto samples = ReadImu(Spline(poses), 200, kExact, 1);
  EXPECT_LT((samples[100].acceleration_body - Eigen::Vector3d(0, -9.81, 0)).norm(), 1e-9);
  EXPECT_LT(samples[100].angular_velocity_body.norm(), 1e-12);

  const ImuNoise white{1.6968e-4, 0, 2.0e-3, 0, 0, 0};
  const auto noisy = ReadImu(Spline(poses), 200, white, 1);
  double gyro = 0;
  double accel = 0;
  for (const ImuSample& sample : noisy) {
    gyro += sample.angular_velocity_body.squaredNorm() / 3 / static_cast<double>(noisy.size());
    accel +=
        (sample.acceleration_body - Eigen::Vector3d(0, -9.81, 0)).squaredNorm() / 3 / static_cast<double>(noisy.size());
  }
  EXPECT_NEAR(std::sqrt(gyro), 1.6968e-4 * std::sqrt(200), 2e-4);
  EXPECT_NEAR(std::sqrt(accel), 2.0e-3 * std::sqrt(200), 2e-3);
}

TEST(ImuTest, BiasWalksAsFastAsItsDensitySays) {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 100; ++i) poses.push_back({int64_t{i} * 100'000'000, Pose3()});
  const MotionSpline still = Spline(poses);
  const ImuNoise walk{0, 1e-2, 0, 0, 0, 0};
  double sum = 0;
  constexpr int kNumRuns = 200;
  for (uint64_t seed = 0; seed < kNumRuns; ++seed) {
    sum += ReadImu(still, 200, walk, seed).back().angular_velocity_body.squaredNorm() / 3 / kNumRuns;
  }
  EXPECT_NEAR(std::sqrt(sum), 1e-2 * std::sqrt(9.9), 4e-3);
}

}  // namespace
}  // namespace mapp::sim
