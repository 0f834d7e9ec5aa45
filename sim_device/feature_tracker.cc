#include "sim_device/feature_tracker.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/keyframe_export.h"
#include "client_sdk/src/tracker/relocalizer.h"
#include "client_sdk/src/tracker/shared_localizer.h"
#include "mapp/base/mutex.h"
#include "mapp/base/process_usage.h"
#include "sim/features/hash.h"
#include "sim_device/keyframe_schedule.h"
#include "sim_device/landmark_points.h"
#include "vision/stereo_matcher.h"

#include <fmt/format.h>

#include <chrono>
#include <utility>

namespace mapp::sim {
namespace {

/// Points that a pose found without a guess must rest on, as in the built-in tracker.
constexpr int kMinRelocalizedPoints = 40;
/// Matches with points of a map left behind that are enough to go on from them.
constexpr int kMinKnownPoints = 30;
constexpr double kKnownRadius_px = 12;

enum : uint64_t { kCameraSeed = 1, kOdometrySeed = 2 };

/// What the network thread asked for since the last frame; the latest counts.
struct SharedMapRequest {
  std::shared_ptr<const SharedMap> map;  ///< null: leave
};

/// What features are measured with: for stereo the rectified pair, whose left camera keyframes refer to.
struct Eye {
  CameraRig rig;
  Pose3 T_camera_eye;
};

StatusOr<Eye> MakeEye(const CameraRig& rig) {
  Eye eye{rig, Pose3()};
  if (rig.sensor == SensorKind::kRgbd) return eye;
  if (rig.sensor != SensorKind::kStereo || !rig.right_camera) {
    return absl::InvalidArgumentError(
        fmt::format("{}: needs RGB-D or stereo, the rig is {}", rig.name, SensorKindName(rig.sensor)));
  }
  MAPP_ASSIGN_OR_RETURN(const auto rectifier, StereoRectifier::Create(rig.camera, *rig.right_camera, rig.T_left_right));
  eye.T_camera_eye = rectifier->T_left_rectified();
  eye.rig.camera = rectifier->rectified();
  eye.rig.right_camera = eye.rig.camera;
  eye.rig.T_left_right = Pose3(Eigen::Quaterniond::Identity(), {eye.rig.camera.stereo_baseline_m, 0, 0});
  return eye;
}

}  // namespace

/// A frame that was looked at.
struct SeenFrame {
  std::shared_ptr<const tracker::Frame> frame;
  std::vector<uint64_t> landmarks;
  std::vector<int> points;  ///< of a shared map, else kNone
};

struct FeatureTracker::Impl {
  Impl(const Eye& with_eye, std::unique_ptr<FeatureCamera> with_camera, const FeatureTrackerOptions& with_options)
      : options(with_options),
        eye(with_eye),
        features(std::move(with_camera)),
        camera(tracker::MakeTrackingCamera(eye.rig.camera, eye.rig.sensor, options.thresholds.max_depth_m)),
        odometry(options.odometry, Hash(options.seed, kOdometrySeed)),
        relocalizer(camera, kMinRelocalizedPoints),
        localizer(shared, camera, options.thresholds),
        schedule(camera, options.thresholds),
        landmark_points(shared, camera) {}

  void ApplyRequest();
  void Move(const Pose3& T_world_eye);
  SeenFrame Look(const Pose3& T_world_eye, int64_t stamp_ns) const;
  void LocalizeOnSharedMap(SeenFrame& seen, TrackingResult& result);
  void AnchorOnKnownPoints(SeenFrame& seen);
  void AddKeyframe(SeenFrame& seen);
  TrackingResult Track(const Pose3& T_world_eye, int64_t stamp_ns);

  const FeatureTrackerOptions options;
  const Eye eye;
  const std::unique_ptr<FeatureCamera> features;
  const tracker::TrackingCamera camera;
  Odometry odometry;
  tracker::SharedSessionMap shared;
  tracker::Relocalizer relocalizer;
  tracker::SharedLocalizer localizer;
  KeyframeSchedule schedule;
  LandmarkPoints landmark_points;

  std::optional<Pose3> T_world_eye_last;
  Pose3 T_session_camera;
  bool on_shared_map = false;
  int frames_since_look = 0;
  std::optional<SeenFrame> last_seen;
  Pose3 T_session_camera_seen;  ///< of `last_seen`
  uint32_t next_number = 0;
  std::vector<Keyframe> keyframes;
  std::vector<TrajectoryPose> trajectory;

  Mutex request_mutex;
  std::optional<SharedMapRequest> request ABSL_GUARDED_BY(request_mutex);
};

void FeatureTracker::Impl::ApplyRequest() {
  std::optional<SharedMapRequest> taken;
  {
    MutexLock lock(request_mutex);
    taken = std::exchange(request, std::nullopt);
  }
  if (!taken) return;
  std::optional<int> retired;
  if (taken->map != nullptr) {
    retired = localizer.Take(*taken->map);
    frames_since_look = options.localize_every;  // this frame is to try it
  } else {
    bool was_adopted = false;
    retired = localizer.Leave(&was_adopted);
    on_shared_map = false;
    if (was_adopted) schedule.ForceNext();
  }
  if (!retired) return;
  MutexLock lock(shared.mutex);
  shared.map.RetireGeneration(*retired);
}

void FeatureTracker::Impl::Move(const Pose3& T_world_eye) {
  if (T_world_eye_last) {
    const Eigen::Vector3d up_before = T_world_eye_last->rotation().conjugate() * Eigen::Vector3d::UnitZ();
    T_session_camera = T_session_camera * odometry.Measure(T_world_eye_last->Inverse() * T_world_eye, up_before);
  }
  T_world_eye_last = T_world_eye;
}

SeenFrame FeatureTracker::Impl::Look(const Pose3& T_world_eye, int64_t stamp_ns) const {
  const std::vector<ObservedFeature> observed = features->Observe(T_world_eye, stamp_ns);
  auto frame = std::make_shared<tracker::Frame>();
  frame->stamp_ns = stamp_ns;
  SeenFrame seen;
  std::vector<FeatureGrid::Point> grid_points;
  for (const ObservedFeature& feature : observed) {
    const Keypoint& keypoint = feature.feature.keypoint;
    frame->features.push_back(feature.feature);
    frame->depths_m.push_back(feature.depth_m);
    frame->pixels.push_back(camera.pinhole.Project(camera.recorded.Unproject({keypoint.u_px, keypoint.v_px})));
    grid_points.push_back({static_cast<float>(frame->pixels.back().x()), static_cast<float>(frame->pixels.back().y())});
    seen.landmarks.push_back(feature.landmark);
  }
  frame->grid = FeatureGrid(grid_points, camera.recorded.width_px, camera.recorded.height_px);
  seen.points.assign(frame->size(), tracker::kNone);
  seen.frame = std::move(frame);
  return seen;
}

void FeatureTracker::Impl::LocalizeOnSharedMap(SeenFrame& seen, TrackingResult& result) {
  const int generation_before = localizer.generation();
  tracker::SharedLocalizer::Outcome outcome =
      localizer.Localize(*seen.frame, T_session_camera, tracker::PoseBound::AroundGuess(T_session_camera), relocalizer);
  on_shared_map = outcome.localized;
  if (outcome.undecided) return;
  result.shared_map_number = outcome.shared_map_number;
  result.num_shared_matches = outcome.num_matches;
  if (!outcome.localized) return;
  T_session_camera = outcome.estimate.T_session_camera;
  seen.points = std::move(outcome.estimate.points);
  if (!outcome.newly_adopted) return;
  // What the device mapped before may be off by the alignment's error.
  landmark_points.Forget();
  schedule.SetReference(tracker::DepthPointViews(*seen.frame, camera, T_session_camera, {}));
  MutexLock lock(shared.mutex);
  shared.map.RetireGeneration(generation_before);
}

void FeatureTracker::Impl::AnchorOnKnownPoints(SeenFrame& seen) {
  if (localizer.known_points().empty()) return;
  tracker::SearchOptions search;
  search.radius_px = kKnownRadius_px;
  tracker::PoseEstimate estimate = tracker::SearchAndRefine(*seen.frame, camera, camera.shared_map, T_session_camera,
                                                            localizer.known_points(), search, 0);
  if (estimate.num_inliers < kMinKnownPoints) return;
  T_session_camera = estimate.T_session_camera;
  seen.points = std::move(estimate.points);
}

void FeatureTracker::Impl::AddKeyframe(SeenFrame& seen) {
  AnchorOnKnownPoints(seen);
  const int keyframe_idx =
      landmark_points.AddKeyframe(seen.frame, seen.landmarks, T_session_camera, seen.points, localizer.generation());
  MutexLock lock(shared.mutex);
  Keyframe keyframe = tracker::ExportKeyframe(shared.map, camera, keyframe_idx);
  keyframe.number = next_number++;
  keyframes.push_back(std::move(keyframe));
  seen.points = shared.map.keyframe(keyframe_idx).points;
}

TrackingResult FeatureTracker::Impl::Track(const Pose3& T_world_eye, int64_t stamp_ns) {
  const auto begin = std::chrono::steady_clock::now();
  const double cpu_before_s = ThreadCpuSeconds();
  ApplyRequest();
  const bool is_first = !T_world_eye_last;
  Move(T_world_eye);
  TrackingResult result;
  result.state = TrackingState::kTracking;
  const bool due = schedule.IsDue(T_session_camera) || is_first;
  ++frames_since_look;
  const bool compare = localizer.in_use() && (due || frames_since_look >= options.localize_every);
  if (due || compare) {
    frames_since_look = 0;
    SeenFrame seen = Look(T_world_eye, stamp_ns);
    if (compare) LocalizeOnSharedMap(seen, result);
    result.is_keyframe = due && !on_shared_map;
    result.would_be_keyframe = due && on_shared_map;
    if (result.is_keyframe) AddKeyframe(seen);
    last_seen = std::move(seen);
    T_session_camera_seen = T_session_camera;
    if (due) schedule.OnKeyframe(tracker::DepthPointViews(*last_seen->frame, camera, T_session_camera, {}));
    for (const int point_idx : last_seen->points) result.num_matches += point_idx != tracker::kNone ? 1 : 0;
  }
  result.on_shared_map = on_shared_map;
  result.T_session_camera = T_session_camera;
  trajectory.push_back({stamp_ns, T_session_camera, on_shared_map,
                        on_shared_map ? std::optional(localizer.T_map_session()) : std::nullopt});
  const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - begin;
  result.tracking_ms = elapsed.count();
  result.tracking_cpu_ms = 1e3 * (ThreadCpuSeconds() - cpu_before_s);
  return result;
}

Status FeatureTrackerOptions::Validate() const {
  MAPP_RETURN_IF_ERROR(thresholds.Validate());
  MAPP_RETURN_IF_ERROR(camera.Validate());
  MAPP_RETURN_IF_ERROR(odometry.Validate());
  if (localize_every < 1 || localize_every > 100) {
    return absl::InvalidArgumentError(fmt::format("localize_every: must be in [1, 100], got {}", localize_every));
  }
  return absl::OkStatus();
}

FeatureTracker::FeatureTracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FeatureTracker::~FeatureTracker() = default;

StatusOr<std::unique_ptr<FeatureTracker>> FeatureTracker::Create(std::shared_ptr<const FeatureWorld> world,
                                                                 const CameraRig& rig,
                                                                 const FeatureTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_ASSIGN_OR_RETURN(const Eye eye, MakeEye(rig));
  MAPP_ASSIGN_OR_RETURN(
      auto camera, FeatureCamera::Create(std::move(world), eye.rig, options.camera, Hash(options.seed, kCameraSeed)));
  return std::unique_ptr<FeatureTracker>(new FeatureTracker(std::make_unique<Impl>(eye, std::move(camera), options)));
}

TrackingResult FeatureTracker::Track(const Pose3& T_world_camera, int64_t stamp_ns) {
  return impl_->Track(T_world_camera * impl_->eye.T_camera_eye, stamp_ns);
}

std::vector<Keyframe> FeatureTracker::TakeKeyframes() { return std::exchange(impl_->keyframes, {}); }

std::optional<Keyframe> FeatureTracker::MakeKeyframeOfLastFrame() {
  if (!impl_->last_seen) return std::nullopt;
  MutexLock lock(impl_->shared.mutex);
  return tracker::ExportFrame(impl_->shared.map, impl_->camera, *impl_->last_seen->frame, impl_->T_session_camera_seen,
                              impl_->last_seen->points);
}

void FeatureTracker::TakeSharedMap(std::shared_ptr<const SharedMap> map) {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{std::move(map)};
}

void FeatureTracker::LeaveSharedMap() {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{nullptr};
}

std::vector<TrajectoryPose> FeatureTracker::Trajectory() const { return impl_->trajectory; }
const Camera& FeatureTracker::camera() const { return impl_->eye.rig.camera; }
SensorKind FeatureTracker::sensor() const { return impl_->eye.rig.sensor; }

}  // namespace mapp::sim
