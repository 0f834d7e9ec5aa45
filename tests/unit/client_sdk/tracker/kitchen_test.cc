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

std::string DataFolder() {
  const char* configured = std::getenv("MAPP_DATA_DIR");
  return configured != nullptr ? configured : std::string(MAPP_SOURCE_DIR) + "/../shared/data";
}

struct Case {
  std::string sequence;
  double max_ate_m;  ///< what established open systems reach on the same frames, at their best
};

class KitchenTest : public ::testing::TestWithParam<Case> {};

TEST_P(KitchenTest, TracksWithinTheErrorOfEstablishedSystems) {
  const std::string folder = DataFolder() + "/redkitchen/" + GetParam().sequence;
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recorded data in " << folder << " (MAPP_DATA_DIR)";
  const auto sequence = OpenSequence(folder);
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  OrbTrackerOptions options;
  options.synchronous = true;
  const auto tracker = OrbTracker::CreateRgbd((*sequence)->camera(), options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();

  size_t num_tracked = 0;
  std::vector<double> tracking_ms;
  for (size_t i = 0; i < (*sequence)->num_frames(); ++i) {
    const auto frame = (*sequence)->Read(i);
    ASSERT_TRUE(frame.ok()) << frame.status();
    TrackerFrame images;
    images.stamp_ns = frame->stamp_ns;
    images.gray = frame->gray.View();
    images.depth_m = frame->depth_m.View();
    const auto result = (*tracker)->Track(images);
    ASSERT_TRUE(result.ok()) << result.status();
    if (result->state == TrackingState::kTracking) ++num_tracked;
    if (!result->is_keyframe) tracking_ms.push_back(result->tracking_ms);
  }
  std::vector<StampedPose> estimate;
  for (const TrajectoryPose& pose : (*tracker)->Trajectory())
    estimate.push_back({pose.stamp_ns, pose.T_session_camera});
  const auto error = AbsoluteTrajectoryError((*sequence)->ground_truth(), estimate, /*with_scale=*/false);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_GE(num_tracked, 0.95 * static_cast<double>((*sequence)->num_frames()));
  EXPECT_LE(error->rmse_m, GetParam().max_ate_m);

  const auto middle = tracking_ms.begin() + static_cast<ptrdiff_t>(tracking_ms.size() / 2);
  std::nth_element(tracking_ms.begin(), middle, tracking_ms.end());
  // Times depend on the machine: they are printed, not tested.
  std::cout << "tracked " << num_tracked << "/" << (*sequence)->num_frames() << ", keyframes "
            << (*tracker)->TakeKeyframes().size() << ", ATE " << error->rmse_m << " m, median tracking " << *middle
            << " ms, local mapping " << (*tracker)->local_mapping().latency.total_ms() << " ms\n";
}

INSTANTIATE_TEST_SUITE_P(RedKitchen, KitchenTest,
                         ::testing::Values(Case{"a", 0.05}, Case{"b", 0.039}, Case{"c", 0.0125}),
                         [](const auto& instance) { return instance.param.sequence; });

}  // namespace
}  // namespace mapp
