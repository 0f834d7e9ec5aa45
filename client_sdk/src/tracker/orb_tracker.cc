#include "mapp/client/orb_tracker.h"

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/tracking_session.h"
#include "mapp/base/mutex.h"
#include "mapp/base/process_usage.h"

#include <fmt/format.h>

#include <chrono>
#include <utility>

namespace mapp {
namespace {

template <typename T>
Status CheckRange(const char* field, T value, T low, T high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: must be in [{}, {}], got {}", field, low, high, value));
}

/// What the network thread asked for since the last frame; the latest counts.
struct SharedMapRequest {
  std::shared_ptr<const SharedMap> map;  ///< null: leave
};

}  // namespace

Status OrbTrackerOptions::Validate() const {
  MAPP_RETURN_IF_ERROR(CheckRange("num_features", num_features, 200, kMaxFeatures));
  MAPP_RETURN_IF_ERROR(CheckRange("max_depth_m", max_depth_m, 0.0, 1000.0));
  MAPP_RETURN_IF_ERROR(CheckRange("min_shared_matches", min_shared_matches, 10, kMaxFeatures));
  MAPP_RETURN_IF_ERROR(CheckRange("min_tracked_points", min_tracked_points, 6, kMaxFeatures));
  MAPP_RETURN_IF_ERROR(CheckRange("max_frames_between_keyframes", max_frames_between_keyframes, 1, 10000));
  MAPP_RETURN_IF_ERROR(CheckRange("num_start_keyframes", num_start_keyframes, 0, 1000));
  MAPP_RETURN_IF_ERROR(CheckRange("max_frames_between_start_keyframes", max_frames_between_start_keyframes, 1, 10000));
  MAPP_RETURN_IF_ERROR(CheckRange("min_reference_ratio", min_reference_ratio, 0.0, 1.0));
  return CheckRange("local_window", local_window, 2, 100);
}

struct OrbTracker::Impl {
  Impl(std::unique_ptr<tracker::FrameBuilder> builder, const OrbTrackerOptions& options)
      : frame_builder(std::move(builder)), session(frame_builder->camera(), options) {}

  void ApplyRequest() {
    std::optional<SharedMapRequest> taken;
    {
      MutexLock lock(request_mutex);
      taken = std::exchange(request, std::nullopt);
    }
    if (!taken) return;
    if (taken->map != nullptr) {
      session.TakeSharedMap(*taken->map);
    } else {
      session.LeaveSharedMap();
    }
  }

  std::unique_ptr<tracker::FrameBuilder> frame_builder;
  tracker::TrackingSession session;
  std::optional<int64_t> last_stamp_ns;

  Mutex request_mutex;
  std::optional<SharedMapRequest> request ABSL_GUARDED_BY(request_mutex);
};

OrbTracker::OrbTracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
OrbTracker::~OrbTracker() = default;

StatusOr<std::unique_ptr<OrbTracker>> OrbTracker::CreateRgbd(const Camera& camera, const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_ASSIGN_OR_RETURN(auto builder, tracker::MakeRgbdFrameBuilder(camera, options));
  return std::unique_ptr<OrbTracker>(new OrbTracker(std::make_unique<Impl>(std::move(builder), options)));
}

StatusOr<std::unique_ptr<OrbTracker>> OrbTracker::CreateStereo(const Camera& left, const Camera& right,
                                                               const Pose3& T_left_right,
                                                               const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_ASSIGN_OR_RETURN(auto builder, tracker::MakeStereoFrameBuilder(left, right, T_left_right, options));
  return std::unique_ptr<OrbTracker>(new OrbTracker(std::make_unique<Impl>(std::move(builder), options)));
}

StatusOr<TrackingResult> OrbTracker::Track(const TrackerFrame& frame) {
  const Stopwatch stopwatch;
  const double cpu_before_s = ThreadCpuSeconds();
  MAPP_RETURN_IF_ERROR(impl_->frame_builder->Validate(frame));
  if (impl_->last_stamp_ns && frame.stamp_ns <= *impl_->last_stamp_ns) {
    return absl::InvalidArgumentError(
        fmt::format("stamp_ns: must be after the last frame's {}, got {}", *impl_->last_stamp_ns, frame.stamp_ns));
  }
  MAPP_ASSIGN_OR_RETURN(const auto built, impl_->frame_builder->Build(frame));
  impl_->last_stamp_ns = frame.stamp_ns;
  impl_->ApplyRequest();
  TrackingResult result = impl_->session.Track(built);
  result.tracking_ms = std::chrono::duration<double, std::milli>(stopwatch.Elapsed()).count();
  result.tracking_cpu_ms = 1e3 * (ThreadCpuSeconds() - cpu_before_s);
  return result;
}

std::vector<Keyframe> OrbTracker::TakeKeyframes() { return impl_->session.mapper().TakeFinished(); }

std::optional<Keyframe> OrbTracker::MakeKeyframeOfLastFrame() const { return impl_->session.MakeKeyframeOfLastFrame(); }

void OrbTracker::WaitForLocalMapping() { impl_->session.mapper().WaitIdle(); }

void OrbTracker::TakeSharedMap(std::shared_ptr<const SharedMap> map) {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{std::move(map)};
}

void OrbTracker::LeaveSharedMap() {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{nullptr};
}

std::vector<TrajectoryPose> OrbTracker::Trajectory() const { return impl_->session.Trajectory(); }

const Camera& OrbTracker::camera() const { return impl_->frame_builder->camera().recorded; }

SensorKind OrbTracker::sensor() const { return impl_->frame_builder->camera().sensor; }

LocalMappingStats OrbTracker::local_mapping() const { return impl_->session.mapper().stats(); }

}  // namespace mapp
