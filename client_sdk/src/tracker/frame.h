#pragma once

#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/base/status.h"
#include "mapp/client/orb_tracker.h"
#include "mapp/feature/feature.h"
#include "mapp/feature/feature_settings.h"
#include "vision/matching.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace mapp::tracker {

/// What tracking and mapping know of one image. Immutable once built: the tracking thread, local mapping and the
/// keyframes share it. Vectors have one entry per feature.
struct Frame {
  int64_t stamp_ns = 0;
  std::vector<Feature> features;        ///< pixels as recorded (stereo: of the rectified left image)
  std::vector<Eigen::Vector2d> pixels;  ///< undistorted
  std::vector<float> depths_m;          ///< measured along the optical axis; 0 = none
  FeatureGrid grid;                     ///< over the undistorted pixels

  size_t size() const { return features.size(); }
};

/// Turns images into frames: extraction, undistortion, a depth for each feature. One thread only.
class FrameBuilder {
 public:
  virtual ~FrameBuilder() = default;
  const TrackingCamera& camera() const { return camera_; }
  const FeatureSettings& feature_settings() const { return feature_settings_; }
  /// INVALID_ARGUMENT naming the image that is missing or of another size than the camera's.
  virtual Status Validate(const TrackerFrame& images) const = 0;
  /// Expects images that passed Validate.
  virtual StatusOr<std::shared_ptr<const Frame>> Build(const TrackerFrame& images) = 0;

 protected:
  FrameBuilder(const TrackingCamera& camera, FeatureSettings feature_settings)
      : camera_(camera), feature_settings_(std::move(feature_settings)) {}
  /// Undistorts and indexes the features of `frame`, whose depths are already set.
  void FinishFrame(Frame* frame) const;

 private:
  TrackingCamera camera_;
  FeatureSettings feature_settings_;
};

StatusOr<std::unique_ptr<FrameBuilder>> MakeMonoFrameBuilder(const Camera& camera, const OrbTrackerOptions& options);
StatusOr<std::unique_ptr<FrameBuilder>> MakeRgbdFrameBuilder(const Camera& camera, const OrbTrackerOptions& options);
StatusOr<std::unique_ptr<FrameBuilder>> MakeStereoFrameBuilder(const Camera& left, const Camera& right,
                                                               const Pose3& T_left_right,
                                                               const OrbTrackerOptions& options);

/// Of the frame's features, in their order.
std::vector<OrbDescriptor> DescriptorsOf(const Frame& frame);

/// Depth at a feature of a registered depth image, metres; 0 where there is no reading at the pixel, or where its
/// surroundings lie at another depth, so that the corner's reading may be the background's.
float LookUpDepth(ImageView<float> depth_m, const Keypoint& keypoint);

}  // namespace mapp::tracker
