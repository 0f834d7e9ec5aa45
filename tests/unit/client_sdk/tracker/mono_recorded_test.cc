// A drone's camera in a machine hall, fast and dark: scale from nothing.
#include "datasets/sequence.h"
#include "eval/metrics/trajectory_metrics.h"
#include "mapp/client/orb_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

namespace mapp {
namespace {

struct MonoCase {
  std::string sequence;
  size_t min_tracked;  ///< of 200 frames, those on which the map was proven included
  double max_ate_m;    ///< scale aligned
};

class MonoRecordedTest : public ::testing::TestWithParam<MonoCase> {};

TEST_P(MonoRecordedTest, TracksWithinTheErrorOfEstablishedSystems) {
  const char* configured = std::getenv("MAPP_DATA_DIR");
  const std::string data = configured != nullptr ? configured : std::string(MAPP_SOURCE_DIR) + "/../shared/data";
  const std::string folder = data + "/euroc_mh05/" + GetParam().sequence;
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recorded data in " << folder << " (MAPP_DATA_DIR)";
  const auto sequence = OpenSequence(folder);
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  const auto tracker = OrbTracker::CreateMono((*sequence)->camera(), {.synchronous = true});
  ASSERT_TRUE(tracker.ok()) << tracker.status();

  size_t num_lost = 0;
  std::vector<double> tracking_ms;
  for (size_t i = 0; i < (*sequence)->num_frames(); ++i) {
    const auto frame = (*sequence)->Read(i);
    ASSERT_TRUE(frame.ok()) << frame.status();
    const auto result = (*tracker)->Track({frame->stamp_ns, frame->gray.View(), {}, {}});
    ASSERT_TRUE(result.ok()) << result.status();
    if (result->state == TrackingState::kLost) ++num_lost;
    if (!result->is_keyframe) tracking_ms.push_back(result->tracking_ms);
  }
  std::vector<StampedPose> estimate;
  for (const TrajectoryPose& pose : (*tracker)->Trajectory()) {
    estimate.push_back({pose.stamp_ns, pose.T_session_camera});
  }
  const auto error = AbsoluteTrajectoryError((*sequence)->ground_truth(), estimate, /*with_scale=*/true);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_GE(estimate.size(), GetParam().min_tracked);
  EXPECT_EQ(num_lost, 0U);
  EXPECT_LE(error->rmse_m, GetParam().max_ate_m);

  const auto middle = tracking_ms.begin() + static_cast<ptrdiff_t>(tracking_ms.size() / 2);
  std::nth_element(tracking_ms.begin(), middle, tracking_ms.end());
  // Times depend on the machine: they are printed, not tested.
  std::cout << "tracked " << estimate.size() << "/" << (*sequence)->num_frames() << ", keyframes "
            << (*tracker)->TakeKeyframes().size() << ", ATE " << error->rmse_m << " m, median tracking " << *middle
            << " ms, local mapping " << (*tracker)->local_mapping().latency.total_ms() << " ms\n";
}

INSTANTIATE_TEST_SUITE_P(EurocMh05, MonoRecordedTest,
                         ::testing::Values(MonoCase{"a", 130, 0.02}, MonoCase{"b", 194, 0.035}),
                         [](const auto& instance) { return instance.param.sequence; });

}  // namespace
}  // namespace mapp
