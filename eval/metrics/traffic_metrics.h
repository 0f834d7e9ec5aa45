#pragma once

#include "eval/metrics/statistics.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace mapp {

/// What a session's messages came to, bytes, from the counters that the client keeps.
struct TrafficTotals {
  /// All moments at which the device mapped or, mapping for itself, would have.
  uint64_t num_keyframes = 0;
  uint64_t keyframe_bytes = 0;  ///< uploads, retries included
  uint64_t query_bytes = 0;     ///< OverlapQuery, all of them
  uint64_t response_bytes = 0;  ///< QueryResponse, all of them
  uint64_t shared_map_bytes = 0;
  uint64_t report_bytes = 0;  ///< ReportUpdate
  uint64_t full_bytes = 0;    ///< what upload_all would have sent at the same moments
};

/// Bytes a keyframe; all absent for a session without keyframes.
struct TrafficPerKeyframe {
  std::optional<double> keyframe, query, response, shared_map, report;
  std::optional<double> up;    ///< keyframe + query + report
  std::optional<double> down;  ///< response + shared_map
  std::optional<double> full;
  std::optional<double> upload_share;  ///< keyframes and reports, of full
};
TrafficPerKeyframe PerKeyframe(const TrafficTotals& totals);

/// 1 - mean overlap of a session's keyframes with the map (paper, section 5.2.1); absent without overlaps.
std::optional<double> FreshnessRatio(std::span<const double> overlaps);

/// What the paper's baseline sends for a keyframe: COVINS (Schmuck et al., ISMAR 2021) with ORB-SLAM3 as its front end,
/// whose messages are cereal's binary archives of uncompressed structs, doubles and 64-bit ids throughout.
struct VanillaKeyframe {
  size_t num_features = 0;
  size_t num_points = 0;            ///< features that observe a map point
  size_t num_new_points = 0;        ///< of these, points that no keyframe sent before
  size_t num_new_observations = 0;  ///< of the new points, by all keyframes so far
  size_t num_imu_samples = 0;       ///< since the keyframe before
};
/// Its size on the wire, bytes:
///  - feature: 88 = keypoint, distorted and undistorted, each two floats with two matrix dimensions (2 x 16); angle,
///    octave, response, size as floats with dimensions (24); ORB descriptor (32);
///  - feature with a point: 20 = feature's number (4) and the point's id (16);
///  - point message, each with its share of a container's header (20): new 73 + 20 an observation = id (16), position
///    in the reference keyframe (32), observations (8 + 20 each), reference keyframe (16), flag (1); sent before: 65,
///    the same without observations. Every keyframe sends all its points again, because they may have moved;
///  - IMU sample: 56 = seven doubles;
///  - once: container header (200), time, ids, calibration, poses, velocity, biases (1,324).
/// Source: covins_comm/include/covins/covins_base/msgs/{msg_keyframe,msg_landmark}.hpp, typedefs_base.hpp,
/// covins_comm/src/covins_base/communicator_base.cpp and orb_slam3/src/comm/communicator.cpp at
/// github.com/VIS4ROB-lab/covins c5b180b.
uint64_t VanillaKeyframeBytes(const VanillaKeyframe& keyframe);

/// The same for a keyframe of which only the counts are known: a fifth of its points are new, each with 3 observations,
/// and 50 IMU samples (4 keyframes a second at 200 Hz). 1000 features with 600 points: 164 KB; the paper measured 161
/// to 168 KB a keyframe on EuRoC.
uint64_t VanillaKeyframeBytes(size_t num_features, size_t num_points);

}  // namespace mapp
