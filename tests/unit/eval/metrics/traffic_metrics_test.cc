#include "eval/metrics/traffic_metrics.h"

#include <gtest/gtest.h>

#include <vector>

namespace mapp {
namespace {

TrafficTotals SomeTotals() {
  return {.num_keyframes = 10,
          .keyframe_bytes = 80'000,
          .query_bytes = 540,
          .response_bytes = 1290,
          .shared_map_bytes = 50'000,
          .report_bytes = 20'000,
          .full_bytes = 400'000};
}

TEST(TrafficTest, BytesAKeyframeByKind) {
  const TrafficPerKeyframe traffic = PerKeyframe(SomeTotals());
  EXPECT_DOUBLE_EQ(*traffic.keyframe, 8000);
  EXPECT_DOUBLE_EQ(*traffic.query, 54);
  EXPECT_DOUBLE_EQ(*traffic.response, 129);
  EXPECT_DOUBLE_EQ(*traffic.shared_map, 5000);
  EXPECT_DOUBLE_EQ(*traffic.report, 2000);
  EXPECT_DOUBLE_EQ(*traffic.up, 10'054);
  EXPECT_DOUBLE_EQ(*traffic.down, 5129);
  EXPECT_DOUBLE_EQ(*traffic.full, 40'000);
  EXPECT_DOUBLE_EQ(*traffic.upload_share, 0.25);
}

TEST(TrafficTest, ASessionWithoutKeyframesHasNoFigures) {
  const TrafficPerKeyframe traffic = PerKeyframe({.query_bytes = 100});
  EXPECT_EQ(traffic.query, std::nullopt);
  EXPECT_EQ(traffic.upload_share, std::nullopt);
}

TEST(TrafficTest, FreshnessIsWhatTheMapDidNotHold) {
  EXPECT_DOUBLE_EQ(*FreshnessRatio(std::vector<double>{0.2, 0.4, 0.9}), 0.5);
  EXPECT_DOUBLE_EQ(*FreshnessRatio(std::vector<double>{1, 1}), 0);
  EXPECT_EQ(FreshnessRatio({}), std::nullopt);
}

TEST(VanillaKeyframeTest, EachPartHasItsSize) {
  const uint64_t empty = VanillaKeyframeBytes(VanillaKeyframe{});
  EXPECT_EQ(empty, 200 + 1324);
  EXPECT_EQ(VanillaKeyframeBytes(VanillaKeyframe{.num_features = 1}) - empty, 88);
  EXPECT_EQ(VanillaKeyframeBytes(VanillaKeyframe{.num_points = 1}) - empty, 20 + 65 + 20);
  EXPECT_EQ(VanillaKeyframeBytes({.num_points = 1, .num_new_points = 1, .num_new_observations = 2}) - empty,
            20 + 73 + 2 * 20 + 20);
  EXPECT_EQ(VanillaKeyframeBytes(VanillaKeyframe{.num_imu_samples = 1}) - empty, 56);
}

TEST(VanillaKeyframeTest, ComesToWhatThePaperMeasured) {
  // Table "ATE and per-device upload traffic for EuRoC": 161 to 168 KB a keyframe; "about 160 KB" in section 4.1.
  EXPECT_NEAR(static_cast<double>(VanillaKeyframeBytes(1000, 600)), 160'000, 8000);
  EXPECT_LT(VanillaKeyframeBytes(1000, 100), 110'000);
  EXPECT_LT(VanillaKeyframeBytes(500, 300), VanillaKeyframeBytes(1000, 600) / 2 + 4000);
}

}  // namespace
}  // namespace mapp
