#include "cli/replay_player.h"

#include "cli/progress_bar.h"
#include "mapp/base/process_usage.h"

#include <fmt/format.h>

#include <condition_variable>
#include <mutex>

namespace mapp {
namespace {

using SteadyClock = std::chrono::steady_clock;

/// Lets each frame pass at its recorded time, counted from the first.
class Pacer {
 public:
  explicit Pacer(int64_t first_stamp_ns) : first_stamp_ns_(first_stamp_ns), start_(SteadyClock::now()) {}

  /// Returns at the frame's time, or at once on a stop request.
  void WaitFor(int64_t stamp_ns, const std::stop_token& stop) {
    const auto due = start_ + std::chrono::nanoseconds(stamp_ns - first_stamp_ns_);
    std::unique_lock lock(mutex_);
    stopped_.wait_until(lock, stop, due, [] { return false; });
  }

 private:
  int64_t first_stamp_ns_;
  SteadyClock::time_point start_;
  // Only ever signalled by the stop token.
  std::mutex mutex_;
  std::condition_variable_any stopped_;
};

FrameRole RoleOf(const TrackingResult& tracking) {
  if (tracking.is_keyframe) return FrameRole::kKeyframe;
  return tracking.on_shared_map && tracking.would_be_keyframe ? FrameRole::kSharedKeyframe : FrameRole::kOrdinary;
}

StatusOr<PlayedFrame> PlayFrame(const Sequence& sequence, size_t frame_idx, Device& device) {
  const double cpu_before_s = GetProcessUsage().cpu_s;
  MAPP_ASSIGN_OR_RETURN(const SequenceFrame frame, sequence.Read(frame_idx));
  const double reading_cpu_s = GetProcessUsage().cpu_s - cpu_before_s;
  const TrackerFrame input{frame.stamp_ns, frame.gray.View(), frame.depth_m.View(), frame.right_gray.View()};
  MAPP_ASSIGN_OR_RETURN(const DevicePose pose, device.Track(input));
  const TrackingResult& tracking = pose.tracking;
  const bool tracked = tracking.state == TrackingState::kTracking;
  return PlayedFrame{.stamp_ns = frame.stamp_ns,
                     .tracked = tracked,
                     .on_shared_map = tracked && tracking.on_shared_map,
                     .role = RoleOf(tracking),
                     .tracking_ms = tracking.tracking_ms,
                     .tracking_cpu_ms = tracking.tracking_cpu_ms,
                     .reading_cpu_s = reading_cpu_s};
}

}  // namespace

StatusOr<std::unique_ptr<OrbTracker>> MakeTracker(const Sequence& sequence) {
  switch (sequence.sensor()) {
    case SensorKind::kRgbd:
      return OrbTracker::CreateRgbd(sequence.camera(), {});
    case SensorKind::kStereo:
      return OrbTracker::CreateStereo(sequence.camera(), *sequence.right_camera(), sequence.T_left_right(), {});
    case SensorKind::kMono:
    case SensorKind::kMonoInertial:
      break;
  }
  return absl::InvalidArgumentError(fmt::format("{}: the built-in tracker needs RGB-D or stereo, the sequence is {}",
                                                sequence.name(), SensorKindName(sequence.sensor())));
}

PlayedFrames Play(const Sequence& sequence, ReplayRate rate, std::chrono::milliseconds patience,
                  const std::stop_token& stop, Device& device) {
  PlayedFrames played;
  ProgressBar progress(sequence.name(), sequence.num_frames());
  Pacer pacer(sequence.stamp_ns(0));
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    if (rate == ReplayRate::kReal) pacer.WaitFor(sequence.stamp_ns(i), stop);
    if (stop.stop_requested()) {
      played.status = absl::CancelledError(
          fmt::format("interrupted after {} of {} frames; the session was closed", i, sequence.num_frames()));
      return played;
    }
    StatusOr<PlayedFrame> frame = PlayFrame(sequence, i, device);
    if (frame.ok()) {
      played.frames.push_back(*frame);
      if (rate == ReplayRate::kMax) played.status = device.WaitIdle(patience);
    } else {
      played.status = frame.status();
    }
    if (!played.status.ok()) {
      played.status = Annotate(played.status, fmt::format("frame {}", i));
      return played;
    }
    progress.Update(i + 1, fmt::format("{:.1f} ms a frame", frame->tracking_ms));
  }
  return played;
}

}  // namespace mapp
