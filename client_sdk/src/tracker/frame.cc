#include "client_sdk/src/tracker/frame.h"

#include "vision/orb_extractor.h"
#include "vision/stereo_matcher.h"

#include <fmt/format.h>

#include <cmath>
#include <future>
#include <utility>

namespace mapp::tracker {
namespace {

template <typename T>
Status ValidateImage(ImageView<T> image, const Camera& camera, const char* field) {
  if (image.empty()) return absl::InvalidArgumentError(fmt::format("{}: image is missing", field));
  if (image.width != camera.width_px || image.height != camera.height_px) {
    return absl::InvalidArgumentError(fmt::format("{}: expected {}x{} pixels as the camera has, got {}x{}", field,
                                                  camera.width_px, camera.height_px, image.width, image.height));
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<OrbExtractor>> MakeExtractor(const OrbTrackerOptions& options) {
  OrbExtractorOptions extractor_options;
  extractor_options.num_features = options.num_features;
  return OrbExtractor::Create(extractor_options);
}

class MonoFrameBuilder : public FrameBuilder {
 public:
  MonoFrameBuilder(const TrackingCamera& camera, std::unique_ptr<OrbExtractor> extractor)
      : FrameBuilder(camera, extractor->feature_settings()), extractor_(std::move(extractor)) {}

  Status Validate(const TrackerFrame& images) const override {
    return ValidateImage(images.gray, camera().recorded, "gray");
  }

  StatusOr<std::shared_ptr<const Frame>> Build(const TrackerFrame& images) override {
    auto frame = std::make_shared<Frame>();
    frame->stamp_ns = images.stamp_ns;
    MAPP_ASSIGN_OR_RETURN(frame->features, extractor_->Extract(images.gray));
    frame->depths_m.assign(frame->size(), 0);
    FinishFrame(frame.get());
    return frame;
  }

 private:
  std::unique_ptr<OrbExtractor> extractor_;
};

class RgbdFrameBuilder : public FrameBuilder {
 public:
  RgbdFrameBuilder(const TrackingCamera& camera, std::unique_ptr<OrbExtractor> extractor)
      : FrameBuilder(camera, extractor->feature_settings()), extractor_(std::move(extractor)) {}

  Status Validate(const TrackerFrame& images) const override {
    MAPP_RETURN_IF_ERROR(ValidateImage(images.gray, camera().recorded, "gray"));
    return ValidateImage(images.depth_m, camera().recorded, "depth_m");
  }

  StatusOr<std::shared_ptr<const Frame>> Build(const TrackerFrame& images) override {
    auto frame = std::make_shared<Frame>();
    frame->stamp_ns = images.stamp_ns;
    MAPP_ASSIGN_OR_RETURN(frame->features, extractor_->Extract(images.gray));
    frame->depths_m.reserve(frame->size());
    for (const Feature& feature : frame->features) {
      frame->depths_m.push_back(LookUpDepth(images.depth_m, feature.keypoint));
    }
    FinishFrame(frame.get());
    return frame;
  }

 private:
  std::unique_ptr<OrbExtractor> extractor_;
};

class StereoFrameBuilder : public FrameBuilder {
 public:
  StereoFrameBuilder(const TrackingCamera& rectified_camera, const Camera& left, const Camera& right,
                     std::unique_ptr<StereoRectifier> rectifier, std::unique_ptr<OrbExtractor> left_extractor,
                     std::unique_ptr<OrbExtractor> right_extractor)
      : FrameBuilder(rectified_camera, left_extractor->feature_settings()),
        left_(left),
        right_(right),
        rectifier_(std::move(rectifier)),
        left_extractor_(std::move(left_extractor)),
        right_extractor_(std::move(right_extractor)) {}

  Status Validate(const TrackerFrame& images) const override {
    MAPP_RETURN_IF_ERROR(ValidateImage(images.gray, left_, "gray"));
    return ValidateImage(images.right_gray, right_, "right_gray");
  }

  StatusOr<std::shared_ptr<const Frame>> Build(const TrackerFrame& images) override {
    rectifier_->Rectify(images.gray, images.right_gray, &left_image_, &right_image_);
    auto frame = std::make_shared<Frame>();
    frame->stamp_ns = images.stamp_ns;
    // Extraction is most of a frame's time, and the images do not need each other.
    auto extracting_right =
        std::async(std::launch::async, [&] { return right_extractor_->Extract(right_image_.View()); });
    auto left_features = left_extractor_->Extract(left_image_.View());
    MAPP_ASSIGN_OR_RETURN(const std::vector<Feature> right_features, extracting_right.get());
    MAPP_ASSIGN_OR_RETURN(frame->features, std::move(left_features));
    frame->depths_m =
        MatchStereo(camera().recorded, frame->features, right_features, left_image_.View(), right_image_.View());
    FinishFrame(frame.get());
    return frame;
  }

 private:
  Camera left_, right_;
  std::unique_ptr<StereoRectifier> rectifier_;
  std::unique_ptr<OrbExtractor> left_extractor_, right_extractor_;
  GrayImage left_image_, right_image_;  ///< rectified; kept for their memory
};

}  // namespace

void FrameBuilder::FinishFrame(Frame* frame) const {
  std::vector<FeatureGrid::Point> grid_points;
  grid_points.reserve(frame->size());
  frame->pixels.reserve(frame->size());
  for (const Feature& feature : frame->features) {
    const Eigen::Vector2d recorded(feature.keypoint.u_px, feature.keypoint.v_px);
    const Eigen::Vector2d pixel = camera_.pinhole.Project(camera_.recorded.Unproject(recorded));
    frame->pixels.push_back(pixel);
    grid_points.push_back({static_cast<float>(pixel.x()), static_cast<float>(pixel.y())});
  }
  frame->grid = FeatureGrid(grid_points, camera_.recorded.width_px, camera_.recorded.height_px);
}

StatusOr<std::unique_ptr<FrameBuilder>> MakeMonoFrameBuilder(const Camera& camera, const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(camera.Validate());
  MAPP_ASSIGN_OR_RETURN(auto extractor, MakeExtractor(options));
  // A baseline is of no use without the other camera's images.
  Camera alone = camera;
  alone.stereo_baseline_m = 0;
  return std::make_unique<MonoFrameBuilder>(MakeTrackingCamera(alone, SensorKind::kMono, 0), std::move(extractor));
}

StatusOr<std::unique_ptr<FrameBuilder>> MakeRgbdFrameBuilder(const Camera& camera, const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(camera.Validate());
  MAPP_ASSIGN_OR_RETURN(auto extractor, MakeExtractor(options));
  return std::make_unique<RgbdFrameBuilder>(MakeTrackingCamera(camera, SensorKind::kRgbd, options.max_depth_m),
                                            std::move(extractor));
}

StatusOr<std::unique_ptr<FrameBuilder>> MakeStereoFrameBuilder(const Camera& left, const Camera& right,
                                                               const Pose3& T_left_right,
                                                               const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(Annotate(left.Validate(), "left"));
  MAPP_RETURN_IF_ERROR(Annotate(right.Validate(), "right"));
  MAPP_ASSIGN_OR_RETURN(auto rectifier, StereoRectifier::Create(left, right, T_left_right));
  MAPP_ASSIGN_OR_RETURN(auto left_extractor, MakeExtractor(options));
  MAPP_ASSIGN_OR_RETURN(auto right_extractor, MakeExtractor(options));
  const TrackingCamera camera = MakeTrackingCamera(rectifier->rectified(), SensorKind::kStereo, options.max_depth_m);
  return std::make_unique<StereoFrameBuilder>(camera, left, right, std::move(rectifier), std::move(left_extractor),
                                              std::move(right_extractor));
}

std::vector<OrbDescriptor> DescriptorsOf(const Frame& frame) {
  std::vector<OrbDescriptor> descriptors;
  descriptors.reserve(frame.size());
  for (const Feature& feature : frame.features) descriptors.push_back(feature.descriptor);
  return descriptors;
}

float LookUpDepth(ImageView<float> depth_m, const Keypoint& keypoint) {
  // Wider than the noise of structured light at its far end (2 % at 6 m), narrower than the steps between objects.
  constexpr float kMaxRelativeStep = 0.05F;
  constexpr int kReach = 1;
  const int x = static_cast<int>(std::lround(keypoint.u_px)), y = static_cast<int>(std::lround(keypoint.v_px));
  if (x < kReach || y < kReach || x >= depth_m.width - kReach || y >= depth_m.height - kReach) return 0;
  const float center = depth_m.at(x, y);
  if (!(center > 0) || !std::isfinite(center)) return 0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx) {
      const float neighbor = depth_m.at(x + dx, y + dy);
      if (neighbor > 0 && std::abs(neighbor - center) > kMaxRelativeStep * center) return 0;
    }
  }
  return center;
}

}  // namespace mapp::tracker
