#include "eval/metrics/traffic_metrics.h"

namespace mapp {
namespace {

// cereal writes a matrix as two 32-bit dimensions and its scalars, a container as a 64-bit size and its elements, a
// cv::Mat as three 32-bit integers and a bool, and a pair of ids as two 64-bit integers.
constexpr uint64_t kDimensions = 8;
constexpr uint64_t kContainer = 8;
constexpr uint64_t kMat = 13;
constexpr uint64_t kId = 16;
constexpr uint64_t kFlag = 1;
constexpr uint64_t kVector3 = kDimensions + 3 * sizeof(double);
constexpr uint64_t kMatrix3 = kDimensions + 9 * sizeof(double);
constexpr uint64_t kMatrix4 = kDimensions + 16 * sizeof(double);

constexpr uint64_t kMessageInfo = 5 * sizeof(uint32_t);
constexpr uint64_t kContainerSize = 10;  // messages; a keyframe fills a container of its own

constexpr uint64_t kKeypoint = kDimensions + 2 * sizeof(float);
constexpr uint64_t kAors = kDimensions + 4 * sizeof(float);
constexpr uint64_t kDescriptor = 32;
constexpr uint64_t kFeature = 2 * kKeypoint + kAors + kDescriptor;
constexpr uint64_t kFeaturePoint = sizeof(int32_t) + kId;
constexpr uint64_t kObservation = kId + sizeof(int32_t);
constexpr uint64_t kUpdatedPoint = kId + kVector3 + kId + kFlag;
constexpr uint64_t kNewPoint = kUpdatedPoint + kContainer;
constexpr uint64_t kImuSample = 7 * sizeof(double);

// T_SC, camera and distortion model, image size, distortion, intrinsics, K; 10 doubles, a0, rate, 2 delays.
constexpr uint64_t kCalibration = kMatrix4 + 2 * sizeof(int32_t) + (kDimensions + 2 * sizeof(double)) +
                                  2 * (kDimensions + 4 * sizeof(double)) + kMatrix3 + 10 * sizeof(double) + kVector3 +
                                  sizeof(int32_t) + 2 * sizeof(double);
// Time, id, calibration, image bounds; the sizes of 2 x 3 lists of keypoints and 2 descriptor matrices (the second set
// is empty with this front end); T_s_c, T_sref_s; 7 vectors; 4 more and 7 lists of the preintegration; the list of
// points; 3 neighbours; a flag; an empty image.
constexpr uint64_t kKeyframe = sizeof(double) + kId + kCalibration + 4 * sizeof(int32_t) + 6 * kContainer + 2 * kMat +
                               2 * kMatrix4 + 7 * kVector3 + 4 * kVector3 + 7 * kContainer + kContainer + 3 * kId +
                               kFlag + kMat;

}  // namespace

TrafficPerKeyframe PerKeyframe(const TrafficTotals& totals) {
  const auto per_keyframe = [&](uint64_t bytes) {
    return Ratio(static_cast<double>(bytes), static_cast<double>(totals.num_keyframes));
  };
  TrafficPerKeyframe traffic;
  traffic.keyframe = per_keyframe(totals.keyframe_bytes);
  traffic.query = per_keyframe(totals.query_bytes);
  traffic.response = per_keyframe(totals.response_bytes);
  traffic.shared_map = per_keyframe(totals.shared_map_bytes);
  traffic.report = per_keyframe(totals.report_bytes);
  traffic.up = per_keyframe(totals.keyframe_bytes + totals.query_bytes + totals.report_bytes);
  traffic.down = per_keyframe(totals.response_bytes + totals.shared_map_bytes);
  traffic.full = per_keyframe(totals.full_bytes);
  traffic.upload_share =
      Ratio(static_cast<double>(totals.keyframe_bytes + totals.report_bytes), static_cast<double>(totals.full_bytes));
  return traffic;
}

std::optional<double> FreshnessRatio(std::span<const double> overlaps) {
  const std::optional<double> mean = Mean(overlaps);
  if (!mean) return std::nullopt;
  return 1 - *mean;
}

uint64_t VanillaKeyframeBytes(const VanillaKeyframe& keyframe) {
  const uint64_t num_known_points = keyframe.num_points - keyframe.num_new_points;
  return kContainerSize * kMessageInfo + kKeyframe + kFeature * keyframe.num_features +
         kFeaturePoint * keyframe.num_points + (kNewPoint + kMessageInfo) * keyframe.num_new_points +
         kObservation * keyframe.num_new_observations + (kUpdatedPoint + kMessageInfo) * num_known_points +
         kImuSample * keyframe.num_imu_samples;
}

uint64_t VanillaKeyframeBytes(size_t num_features, size_t num_points) {
  const size_t num_new_points = num_points / 5;
  return VanillaKeyframeBytes({.num_features = num_features,
                               .num_points = num_points,
                               .num_new_points = num_new_points,
                               .num_new_observations = 3 * num_new_points,
                               .num_imu_samples = 50});
}

}  // namespace mapp
