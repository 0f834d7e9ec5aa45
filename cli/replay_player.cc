#include "cli/replay_player.h"

#include "cli/progress_bar.h"

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

StatusOr<PlayedFrame> PlayFrame(const ReplaySource& source, size_t frame_idx, ReplayDevice& device) {
  MAPP_ASSIGN_OR_RETURN(const PlayedStep step, device.Play(frame_idx));
  const TrackingResult& tracking = step.tracking;
  const bool tracked = tracking.state == TrackingState::kTracking;
  return PlayedFrame{.stamp_ns = source.stamp_ns(frame_idx),
                     .tracked = tracked,
                     .on_shared_map = tracked && tracking.on_shared_map,
                     .num_shared_matches = tracking.num_shared_matches,
                     .role = RoleOf(tracking),
                     .tracking_ms = tracking.tracking_ms,
                     .tracking_cpu_ms = tracking.tracking_cpu_ms,
                     .extraction_cpu_ms = tracking.extraction_cpu_ms,
                     .reading_cpu_s = step.reading_cpu_s};
}

}  // namespace

PlayedFrames Play(const ReplaySource& source, ReplayRate rate, std::chrono::milliseconds patience,
                  const std::stop_token& stop, ReplayDevice& device) {
  PlayedFrames played;
  ProgressBar progress(source.name(), source.num_frames());
  Pacer pacer(source.stamp_ns(0));
  for (size_t i = 0; i < source.num_frames(); ++i) {
    if (rate == ReplayRate::kReal) pacer.WaitFor(source.stamp_ns(i), stop);
    if (stop.stop_requested()) {
      played.status = absl::CancelledError(
          fmt::format("interrupted after {} of {} frames; the session was closed", i, source.num_frames()));
      return played;
    }
    StatusOr<PlayedFrame> frame = PlayFrame(source, i, device);
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
