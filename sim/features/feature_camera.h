#pragma once

#include "mapp/base/status.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"
#include "sim/features/feature_world.h"
#include "sim/world/camera_rig.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <vector>

namespace mapp::sim {

/// What a camera and ORB add to the truth. Random, view and contrast noise were set on rendered views of a
/// room and a garage (docs/evaluation/feature_level.md), the others estimated.
struct FeatureNoise {
  int num_features = kMaxFeatures;  ///< at most; range [1, kMaxFeatures]
  /// Sigma of a corner's place in pixels of its octave, before it is rounded to them as FAST's corners are.
  double pixel_px = 0.3;
  double angle_rad = 0.05;  ///< sigma of the orientation
  /// Sigma of a corner's contrast, as a share, in the same way in views of one kind: decides which of many corners are
  /// among the image's.
  double view_response_ratio = 0.14;
  double image_response_ratio = 0.09;  ///< ... and in each image
  /// Mean number of descriptor bits that flip in an image, whatever it shows.
  double random_bits = 14.5;
  /// Bits that differ per unit of foreshortening ln(1 / cos): the same ones for the same corner and direction. With
  /// random_bits twice, 50 degrees from straight ahead give some 60 bits.
  double view_bits = 75;
  /// ... and per octave that the corner appears larger or smaller than at its best.
  double scale_bits = 20;
  /// Features of each image that no landmark stands behind: where one thing ends before another, noise, reflections.
  double clutter_ratio = 0.08;
  /// RGB-D: sigma of depth z is this times z^2, 1/m; see SensorNoise.
  double depth_sigma_per_m = 0.0012;
  double max_depth_m = 8;  ///< RGB-D: no reading beyond
  /// Stereo: sigma of the disparity in pixels of the octave.
  double disparity_px = 0.35;
  double depth_missing_ratio = 0.06;  ///< of features without a reading for no reason; stereo: without a match
  double depth_outlier_ratio = 0.01;  ///< of readings that are off by up to a third

  Status Validate() const;  ///< INVALID_ARGUMENT naming the first field out of range.
};

/// A feature, and the truth behind it.
struct ObservedFeature {
  Feature feature;        ///< pixel as recorded (stereo: of the left image)
  float depth_m = 0;      ///< measured along the optical axis; 0: no reading
  uint64_t landmark = 0;  ///< 0: clutter
  uint32_t object_id = 0;
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();  ///< of the landmark
};

/// Sees a world's landmarks as ORB features, with what noise says: at most 1000 spread over the image and the pyramid
/// by the extractor's rule, the strongest first, none behind another surface. One seed gives one device's noise; the
/// same call gives the same features. Thread-safe.
class FeatureCamera {
 public:
  /// `world` must not be null. INVALID_ARGUMENT: a camera that Camera::Validate() refuses, or noise out of range.
  static StatusOr<std::unique_ptr<FeatureCamera>> Create(std::shared_ptr<const FeatureWorld> world,
                                                         const CameraRig& rig, const FeatureNoise& noise,
                                                         uint64_t seed);

  /// Takes some 5 ms among things, and as much again for each part of a texture met for the first time
  /// (bench/feature_bench).
  std::vector<ObservedFeature> Observe(const Pose3& T_world_camera, int64_t stamp_ns) const;
  const CameraRig& rig() const { return rig_; }

 private:
  FeatureCamera(std::shared_ptr<const FeatureWorld> world, const CameraRig& rig, const FeatureNoise& noise,
                uint64_t seed)
      : world_(std::move(world)), rig_(rig), noise_(noise), seed_(seed) {}

  std::shared_ptr<const FeatureWorld> world_;
  CameraRig rig_;
  FeatureNoise noise_;
  uint64_t seed_;
};

}  // namespace mapp::sim
