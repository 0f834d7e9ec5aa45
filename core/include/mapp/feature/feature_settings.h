#pragma once

#include "mapp/base/status.h"
#include "mapp/feature/feature.h"

#include <optional>
#include <string>

namespace mapp {

/// What decides whether the features of two devices can be compared: the descriptor's meaning and the pyramid it is
/// taken from. A map has one, from the session that created it, and takes sessions of no other. Defaults: OrbExtractor.
///
/// What only decides which corners are found is not part of it and may differ between devices: the number of features,
/// FAST thresholds, cells.
struct FeatureSettings {
  /// Name of the 256-bit binary descriptor, compared by Hamming distance, with all that changes its bits but the patch:
  /// test pattern, orientation, smoothing. "ORB-256": OpenCV's learned pattern of pairs, turned by the intensity
  /// centroid, on a level smoothed by a Gaussian of 2 pixels (Rublee et al. 2011). 1 to 32 of A-Z a-z 0-9 . _ + -
  std::string descriptor_kind = "ORB-256";
  /// Ratio of neighbouring pyramid levels: a descriptor of octave o covers scale_factor ^ o of the pixels of octave 0,
  /// and o tells the distance and the keypoint's noise. Range [1.01, 4]; two within 1e-4 of each other are the same.
  float scale_factor = kPyramidScale;
  /// Octaves are below it. It tells from how near a point is still detected, so that one not seen from nearer is not
  /// taken for gone. Range [1, kPyramidLevels], which is what a keyframe packet holds.
  int num_levels = kPyramidLevels;
  /// Edge of the square patch that the descriptor's tests reach, pixels of the level. Range [3, 255].
  int patch_size_px = 31;

  /// INVALID_ARGUMENT naming the field, as "feature_settings.scale_factor: ...".
  Status Validate() const;
};

/// A field in which two settings differ.
struct FeatureSettingsDifference {
  std::string field;  ///< such as "scale_factor"
  std::string a, b;   ///< its values
};
/// The first one in the order above; nullopt when features of both can be compared.
std::optional<FeatureSettingsDifference> FirstDifference(const FeatureSettings& a, const FeatureSettings& b);

}  // namespace mapp
