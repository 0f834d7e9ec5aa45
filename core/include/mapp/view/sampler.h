#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/view/depth_sketch.h"

#include <Eigen/Core>

#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace mapp {

/// How the map's knowledge of a view is assessed (DESIGN 5): by samples, evenly through the view cone or at the depths
/// of the sketch, or by the bins of the view that hold points. The numbers are on the wire.
enum class SamplerKind : uint8_t { kUniform = 1, kDepthSketch = 2, kOccupancy = 3 };

/// The sample points of one query, in the query camera's frame. Both sides derive the same ones.
struct SampleSet {
  SamplerKind kind = SamplerKind::kDepthSketch;
  std::vector<Eigen::Vector3f> p_camera;  ///< metres
  /// uniform: radius r in metres. depth_sketch: radius a in the scaled coordinates of ScaledCoordinates().
  float radius = 0;
};

/// w = (x/z, y/z, ln(z)/2): distances in w are lateral shares of the depth, with depth counted half as strictly.
inline Eigen::Vector3f ScaledCoordinates(const Eigen::Vector3f& p_camera) {
  return {p_camera.x() / p_camera.z(), p_camera.y() / p_camera.z(), 0.5F * std::log(p_camera.z())};
}

/// The point with scaled coordinates `w`.
inline Eigen::Vector3f FromScaledCoordinates(const Eigen::Vector3f& w) {
  const float z = std::exp(2 * w.z());
  return {w.x() * z, w.y() * z, z};
}

/// K points evenly through the cone's volume (a fixed low-discrepancy sequence), r = (volume / K)^(1/3): the paper's.
SampleSet SampleUniform(double field_of_view, double range_m, int num_samples);

/// At most `num_samples` points where the sketch says the keyframe's own points are; none for an empty sketch.
/// Each cell's ln-depth range is padded by 0.08, samples shared out in proportion to it by integer arithmetic on the
/// codes, low-discrepancy in (u, v, ln z); a = max((V / K)^(1/3), 0.06), V the sampled volume in w (OVERLAP study).
SampleSet SampleDepthSketch(const Camera& camera, const DepthSketch& sketch, int num_samples);

/// The device's count: which of its own points the map already holds.
struct OverlapCount {
  std::vector<bool> redundant;  ///< one per own point
  double overlap = 0;           ///< redundant share; 0 without points
};

/// uniform: a point is redundant within r of a REDUNDANT sample (paper section 4.2).
/// depth_sketch: by vote, more than 2 of its 4 nearest samples REDUNDANT and the nearest within 3a.
/// `sample_redundant` has one entry per sample; `own_points` are in the camera's frame, metres.
OverlapCount CountBySamples(const SampleSet& samples, const std::vector<bool>& sample_redundant,
                            std::span<const Eigen::Vector3d> own_points);

}  // namespace mapp
