#include "tests/support/recorded_walk.h"

#include "datasets/sequence.h"
#include "vision/matching.h"
#include "vision/orb_extractor.h"
#include "vision/stereo_matcher.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace mapp::testing {
namespace {

constexpr float kMinDepthM = 0.3F;
constexpr float kMaxDepthM = 8.0F;
constexpr float kSearchRadiusPx = 8.0F;

struct TrackedPoint {
  Eigen::Vector3d p_world;
  OrbDescriptor descriptor;
  float reference_distance_m;
  uint16_t num_observations;
};

float DepthAt(const DepthImage& depth, const Keypoint& keypoint, float depth_when_missing_m) {
  if (depth.empty()) return depth_when_missing_m;
  const int x = std::clamp(static_cast<int>(std::lround(keypoint.u_px)), 0, depth.width - 1);
  const int y = std::clamp(static_cast<int>(std::lround(keypoint.v_px)), 0, depth.height - 1);
  const float depth_m = depth.at(x, y);
  return depth_m >= kMinDepthM && depth_m <= kMaxDepthM ? depth_m : 0.0F;
}

/// Follows points from keyframe to keyframe under known poses.
class PointTracker {
 public:
  explicit PointTracker(const Camera& camera) : camera_(camera) {}

  /// Gives features with depth their point's number, a new one where no known point fits.
  void Track(const Pose3& T_world_camera, const std::vector<Feature>& features, const std::vector<float>& depths_m,
             Keyframe& keyframe) {
    std::vector<int> numbers(features.size(), -1);
    for (const Match& match : MatchKnown(T_world_camera, features)) {
      const int number = projected_points_[match.query_idx];
      const Eigen::Vector3d p_camera = T_world_camera.Inverse() * points_[number].p_world;
      const float depth_m = depths_m[match.train_idx];
      if (depth_m > 0 && std::abs(p_camera.z() - depth_m) < 0.05 * depth_m) numbers[match.train_idx] = number;
    }
    for (size_t i = 0; i < features.size(); ++i) {
      KeyframeFeature feature{.keypoint = features[i].keypoint, .descriptor = features[i].descriptor, .point = {}};
      if (depths_m[i] > 0) feature.point = Refer(T_world_camera, features[i], depths_m[i], numbers[i]);
      keyframe.features.push_back(feature);
    }
  }

 private:
  std::vector<Match> MatchKnown(const Pose3& T_world_camera, const std::vector<Feature>& features) {
    std::vector<FeatureGrid::Point> pixels;
    for (const Feature& feature : features) pixels.push_back({feature.keypoint.u_px, feature.keypoint.v_px});
    const FeatureGrid grid(pixels, camera_.width_px, camera_.height_px);
    std::vector<ProjectedPoint> projected;
    projected_points_.clear();
    const Pose3 T_camera_world = T_world_camera.Inverse();
    for (size_t i = 0; i < points_.size(); ++i) {
      const Eigen::Vector3d p_camera = T_camera_world * points_[i].p_world;
      if (p_camera.z() < kMinDepthM) continue;
      const Eigen::Vector2d pixel = camera_.Project(p_camera);
      if (!camera_.Contains(pixel)) continue;
      const int octave = PredictOctave(points_[i].reference_distance_m, static_cast<float>(p_camera.norm()));
      projected.push_back({static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), kSearchRadiusPx, octave,
                           points_[i].descriptor});
      projected_points_.push_back(static_cast<int>(i));
    }
    return MatchProjected(projected, grid, features, {.max_distance = 60, .max_ratio = 0.9});
  }

  PointReference Refer(const Pose3& T_world_camera, const Feature& feature, float depth_m, int number) {
    if (number < 0) {
      number = static_cast<int>(points_.size());
      const Eigen::Vector3d p_camera = depth_m * camera_.Unproject({feature.keypoint.u_px, feature.keypoint.v_px});
      points_.push_back(
          {.p_world = T_world_camera * p_camera,
           .descriptor = feature.descriptor,
           .reference_distance_m = static_cast<float>(p_camera.norm()) * OctaveScale(feature.keypoint.octave),
           .num_observations = 0});
    }
    TrackedPoint& point = points_[number];
    ++point.num_observations;
    return {.kind = PointReference::Kind::kSessionPoint,
            .id = static_cast<uint64_t>(number) + 1,
            .depth_m = depth_m,
            .num_observations = point.num_observations};
  }

  Camera camera_;
  std::vector<TrackedPoint> points_;
  std::vector<int> projected_points_;
};

const Pose3& NearestTruth(const Sequence& sequence, int64_t stamp_ns) {
  const std::vector<StampedPose>& truth = sequence.ground_truth();
  return std::min_element(truth.begin(), truth.end(),
                          [stamp_ns](const StampedPose& a, const StampedPose& b) {
                            return std::abs(a.stamp_ns - stamp_ns) < std::abs(b.stamp_ns - stamp_ns);
                          })
      ->T_world_camera;
}

struct ObservedFrame {
  Pose3 T_world_camera;
  std::vector<Feature> features;
  std::vector<float> depths_m;  ///< per feature, 0 = none
};

/// Features and their depths, whatever sensor the sequence was recorded with.
class FrameReader {
 public:
  static StatusOr<FrameReader> Create(const Sequence& sequence, float depth_when_missing_m) {
    FrameReader reader(sequence, depth_when_missing_m);
    MAPP_ASSIGN_OR_RETURN(reader.extractor_, OrbExtractor::Create({}));
    if (sequence.sensor() == SensorKind::kStereo) {
      MAPP_ASSIGN_OR_RETURN(reader.rectifier_, StereoRectifier::Create(sequence.camera(), *sequence.right_camera(),
                                                                       sequence.T_left_right()));
    }
    return reader;
  }

  const Camera& camera() const { return rectifier_ ? rectifier_->rectified() : sequence_->camera(); }

  StatusOr<ObservedFrame> Read(size_t frame_idx) {
    MAPP_ASSIGN_OR_RETURN(const SequenceFrame frame, sequence_->Read(frame_idx));
    ObservedFrame observed{.T_world_camera = NearestTruth(*sequence_, frame.stamp_ns), .features = {}, .depths_m = {}};
    if (rectifier_) {
      MAPP_RETURN_IF_ERROR(ReadStereo(frame, observed));
      return observed;
    }
    MAPP_ASSIGN_OR_RETURN(observed.features, extractor_->Extract(frame.gray.View()));
    for (const Feature& feature : observed.features) {
      observed.depths_m.push_back(DepthAt(frame.depth_m, feature.keypoint, depth_when_missing_m_));
    }
    return observed;
  }

 private:
  FrameReader(const Sequence& sequence, float depth_when_missing_m)
      : sequence_(&sequence), depth_when_missing_m_(depth_when_missing_m) {}

  Status ReadStereo(const SequenceFrame& frame, ObservedFrame& observed) {
    GrayImage left;
    GrayImage right;
    rectifier_->Rectify(frame.gray.View(), frame.right_gray.View(), &left, &right);
    MAPP_ASSIGN_OR_RETURN(observed.features, extractor_->Extract(left.View()));
    MAPP_ASSIGN_OR_RETURN(const std::vector<Feature> right_features, extractor_->Extract(right.View()));
    observed.depths_m = MatchStereo(camera(), observed.features, right_features, left.View(), right.View());
    observed.T_world_camera = observed.T_world_camera * rectifier_->T_left_rectified();
    return absl::OkStatus();
  }

  const Sequence* sequence_;
  float depth_when_missing_m_;
  std::unique_ptr<OrbExtractor> extractor_;
  std::unique_ptr<StereoRectifier> rectifier_;
};

}  // namespace

StatusOr<RecordedWalk> LoadRecordedWalk(const std::string& folder, size_t stride, float depth_when_missing_m) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Sequence> sequence, OpenSequence(folder));
  MAPP_ASSIGN_OR_RETURN(FrameReader reader, FrameReader::Create(*sequence, depth_when_missing_m));
  RecordedWalk walk;
  walk.camera = reader.camera();
  PointTracker tracker(walk.camera);
  for (size_t i = 0; i < sequence->num_frames(); i += stride) {
    MAPP_ASSIGN_OR_RETURN(const ObservedFrame frame, reader.Read(i));
    walk.T_world_cameras.push_back(frame.T_world_camera);
    Keyframe keyframe;
    keyframe.number = static_cast<uint32_t>(walk.keyframes.size());
    keyframe.stamp_ns = sequence->stamp_ns(i);
    keyframe.T_frame_camera = walk.T_world_session().Inverse() * frame.T_world_camera;
    tracker.Track(frame.T_world_camera, frame.features, frame.depths_m, keyframe);
    walk.keyframes.push_back(std::move(keyframe));
  }
  return walk;
}

std::string DataFolder() {
  const char* const folder = std::getenv("MAPP_DATA_DIR");
  const std::string path = folder != nullptr ? folder : std::string(MAPP_SOURCE_DIR) + "/../shared/data";
  return std::filesystem::is_directory(path) ? path : std::string();
}

}  // namespace mapp::testing
