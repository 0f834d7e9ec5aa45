#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"

#include <memory>
#include <span>
#include <vector>

namespace mapp {

/// Rectifies a calibrated pair to row-aligned pinhole images with the left camera's frame turned to the rectified one.
class StereoRectifier {
 public:
  /// `T_left_right`: pose of the right camera in the left camera's frame.
  /// INVALID_ARGUMENT for a bad camera, differing image sizes, a baseline below 1 mm, or a second camera that does not
  /// lie to the right of the first.
  static StatusOr<std::unique_ptr<StereoRectifier>> Create(const Camera& left, const Camera& right,
                                                           const Pose3& T_left_right);
  ~StereoRectifier();
  /// Pinhole camera of the rectified left image; stereo_baseline_m set.
  const Camera& rectified() const;
  /// T_left_rectified: pose of the rectified camera in the left camera's frame (a pure rotation).
  const Pose3& T_left_rectified() const;
  /// An output is empty when its input is not of the calibrated size.
  void Rectify(ImageView<uint8_t> left, ImageView<uint8_t> right, GrayImage* rectified_left,
               GrayImage* rectified_right) const;

 private:
  struct Impl;
  explicit StereoRectifier(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Depth of each left feature from the rectified right image: row-band descriptor search, then sub-pixel refinement by
/// sliding a patch (Mur-Artal and Tardos 2017, section III). 0 where no match passes.
std::vector<float> MatchStereo(const Camera& rectified, std::span<const Feature> left, std::span<const Feature> right,
                               ImageView<uint8_t> left_image, ImageView<uint8_t> right_image);

}  // namespace mapp
