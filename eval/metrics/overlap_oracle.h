#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"

#include <memory>
#include <numbers>
#include <span>
#include <vector>

namespace mapp {

/// A point that a map holds, with all the places that it was seen from.
struct SeenPoint {
  Eigen::Vector3d p_map;
  OrbDescriptor descriptor;
  std::vector<Eigen::Vector3d> observers_map;  ///< camera centres
};

/// When a map counts as holding what a device sees; the values of the study behind DESIGN 5.
struct OracleRule {
  double min_reach_m = 0.05;  ///< a map point is the own one within this of it,
  double reach_ratio = 0.05;  ///< or within this share of the own point's depth, whichever is more,
  double like_view_angle = 50.0 * std::numbers::pi / 180.0;  ///< if it was seen from within this of the view's ray
  double match_px = 15;                                      ///< a descriptor matches within this of the own keypoint
  int max_hamming = 50;                                      ///< if at most this many bits differ
};

/// What a map truly holds of a view: the truth that estimates of overlap are judged by. It searches every point that
/// the map has, by geometry or by looks, and knows nothing of samples, bins or neighbour frames. Thread-safe.
class OverlapOracle {
 public:
  /// INVALID_ARGUMENT: a point that is not finite. A map without points knows nothing.
  static StatusOr<std::unique_ptr<OverlapOracle>> Create(std::vector<SeenPoint> points, const OracleRule& rule = {});
  ~OverlapOracle();

  /// For each own point (camera frame, metres, z > 0): whether a map point lies there that was seen alike.
  std::vector<bool> KnownByGeometry(const Pose3& T_map_camera, std::span<const Eigen::Vector3d> own_camera) const;
  /// For each own feature: whether a map point projects near it and looks like it.
  std::vector<bool> KnownByDescriptor(const Pose3& T_map_camera, const Camera& camera,
                                      std::span<const Feature> own) const;

 private:
  struct Impl;
  explicit OverlapOracle(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
