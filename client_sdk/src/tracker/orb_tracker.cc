#include "mapp/client/orb_tracker.h"

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/restart_policy.h"
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
  MAPP_RETURN_IF_ERROR(CheckRange("max_search_s", max_search_s, 0.0, 3600.0));
  MAPP_RETURN_IF_ERROR(CheckRange("max_young_search_s", max_young_search_s, 0.0, 3600.0));
  MAPP_RETURN_IF_ERROR(CheckRange("num_young_keyframes", num_young_keyframes, 0, 10000));
  return CheckRange("local_window", local_window, 2, 100);
}

struct OrbTracker::Impl {
  Impl(std::unique_ptr<tracker::FrameBuilder> builder, const OrbTrackerOptions& with_options)
      : options(with_options), frame_builder(std::move(builder)), restart_policy(options) {
    BeginSession();
  }

  void BeginSession() { session = std::make_unique<tracker::TrackingSession>(frame_builder->camera(), options); }

  TrackingResult Track(const std::shared_ptr<const tracker::Frame>& frame) {
    TrackingResult result = session->Track(frame);
    const bool idle = session->mapper().idle();
    if (session->failed_to_start() && idle) {
      BeginSession();
      result = session->Track(frame);
    }
    const bool lost = result.state == TrackingState::kLost;
    const bool restart = restart_policy.IsDue({.stamp_ns = frame->stamp_ns,
                                               .lost = lost,
                                               .can_start = lost && session->CanStart(*frame),
                                               .num_keyframes = session->num_keyframes()});
    // Lost for long, local mapping has nothing left to do: what it has made is final.
    if (restart && idle) {
      EndFragment();
      result = session->Track(frame);
    }
    result.fragment = fragment;
    return result;
  }

  void EndFragment() {
    ended.push_back({fragment++, session->TakeKeyframes(), session->Trajectory()});
    ended_mapping.Add(session->mapper().latency());
    ended_mapping_cpu_s += session->mapper().cpu_s();
    BeginSession();
  }

  void ApplyRequest() {
    std::optional<SharedMapRequest> taken;
    {
      MutexLock lock(request_mutex);
      taken = std::exchange(request, std::nullopt);
    }
    if (!taken) return;
    if (taken->map != nullptr) {
      session->TakeSharedMap(*taken->map);
    } else {
      session->LeaveSharedMap();
    }
  }

  const OrbTrackerOptions options;
  std::unique_ptr<tracker::FrameBuilder> frame_builder;
  std::unique_ptr<tracker::TrackingSession> session;  // of the present fragment
  std::optional<int64_t> last_stamp_ns;

  tracker::RestartPolicy restart_policy;
  uint32_t fragment = 0;
  std::vector<EndedFragment> ended;
  LatencyRecorder ended_mapping;  // local mapping of the fragments before
  double ended_mapping_cpu_s = 0;

  Mutex request_mutex;
  std::optional<SharedMapRequest> request ABSL_GUARDED_BY(request_mutex);
};

OrbTracker::OrbTracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
OrbTracker::~OrbTracker() = default;

StatusOr<std::unique_ptr<OrbTracker>> OrbTracker::CreateMono(const Camera& camera, const OrbTrackerOptions& options) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  MAPP_ASSIGN_OR_RETURN(auto builder, tracker::MakeMonoFrameBuilder(camera, options));
  return std::unique_ptr<OrbTracker>(new OrbTracker(std::make_unique<Impl>(std::move(builder), options)));
}

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
  const double extraction_cpu_s = ThreadCpuSeconds() - cpu_before_s;
  impl_->last_stamp_ns = frame.stamp_ns;
  impl_->ApplyRequest();
  TrackingResult result = impl_->Track(built);
  result.tracking_ms = std::chrono::duration<double, std::milli>(stopwatch.Elapsed()).count();
  result.extraction_cpu_ms = 1e3 * extraction_cpu_s;
  result.tracking_cpu_ms = 1e3 * (ThreadCpuSeconds() - cpu_before_s);
  return result;
}

std::vector<Keyframe> OrbTracker::TakeKeyframes() { return impl_->session->TakeKeyframes(); }

std::vector<EndedFragment> OrbTracker::TakeEndedFragments() { return std::exchange(impl_->ended, {}); }

std::optional<Keyframe> OrbTracker::MakeKeyframeOfLastFrame() const {
  return impl_->session->MakeKeyframeOfLastFrame();
}

void OrbTracker::WaitForLocalMapping() { impl_->session->mapper().WaitIdle(); }

void OrbTracker::TakeSharedMap(std::shared_ptr<const SharedMap> map) {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{std::move(map)};
}

void OrbTracker::LeaveSharedMap() {
  MutexLock lock(impl_->request_mutex);
  impl_->request = SharedMapRequest{nullptr};
}

std::vector<TrajectoryPose> OrbTracker::Trajectory() const { return impl_->session->Trajectory(); }

const Camera& OrbTracker::camera() const { return impl_->frame_builder->camera().recorded; }

SensorKind OrbTracker::sensor() const { return impl_->frame_builder->camera().sensor; }

const FeatureSettings& OrbTracker::feature_settings() const { return impl_->frame_builder->feature_settings(); }

LocalMappingStats OrbTracker::local_mapping() const {
  LatencyRecorder latency = impl_->ended_mapping;
  latency.Add(impl_->session->mapper().latency());
  return {latency.Summary(), impl_->ended_mapping_cpu_s + impl_->session->mapper().cpu_s()};
}

}  // namespace mapp
