#include "cli/replay.h"

#include "cli/frame_log.h"
#include "cli/replay_player.h"
#include "cli/replay_report.h"
#include "cli/sequence_source.h"
#include "datasets/sequence.h"
#include "eval/trajectory_metrics.h"
#include "text/file_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace mapp {
namespace {

/// Session poses, in the map's frame once the session is aligned.
struct SessionTrajectory {
  bool in_map = false;
  std::vector<TrajectoryPose> poses;  ///< T_map_camera when `in_map`, else T_session_camera

  std::vector<StampedPose> Stamped() const {
    std::vector<StampedPose> stamped;
    for (const TrajectoryPose& pose : poses) stamped.push_back({pose.stamp_ns, pose.T_session_camera});
    return stamped;
  }
};

SessionTrajectory TrajectoryOf(const Device& device) {
  if (auto in_map = device.TrajectoryInMap()) return {true, std::move(*in_map)};
  return {false, device.tracker().Trajectory()};
}

/// The alignment of truth and map as the map's first session gives it.
StatusOr<std::optional<Sim3>> JointAlignment(const ReplayOptions& options, const Sequence& sequence) {
  if (!options.align_by) return std::optional<Sim3>();
  if (sequence.ground_truth().empty()) {
    return absl::InvalidArgumentError(fmt::format("--align-by: {} has no ground truth", sequence.name()));
  }
  MAPP_ASSIGN_OR_RETURN(const auto truth, ReadTumTrajectory(options.align_by->truth_file));
  MAPP_ASSIGN_OR_RETURN(const auto trajectory, ReadTumTrajectory(options.align_by->trajectory_file));
  StatusOr<TrajectoryError> error = AbsoluteTrajectoryError(truth, trajectory, /*with_scale=*/false);
  if (!error.ok()) return Annotate(error.status(), "--align-by");
  return std::optional<Sim3>(error->T_truth_estimate);
}

/// Nearest-rank percentile; `ratio` in (0, 1].
double Percentile(std::vector<double> values, double ratio) {
  if (values.empty()) return 0;
  const auto rank = static_cast<size_t>(std::ceil(ratio * static_cast<double>(values.size())));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::max<size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

void FillFrames(const std::vector<PlayedFrame>& frames, ReplayReport& report) {
  std::vector<double> tracking_ms;
  report.frames = frames.size();
  for (const PlayedFrame& frame : frames) {
    report.frames_tracked += frame.tracked ? 1 : 0;
    report.frames_on_shared_map += frame.on_shared_map ? 1 : 0;
    tracking_ms.push_back(frame.tracking_ms);
  }
  report.tracking_ms_p50 = Percentile(tracking_ms, 0.5);
  report.tracking_ms_p95 = Percentile(tracking_ms, 0.95);
}

void FillParticipation(const Device& device, ReplayReport& report) {
  const ParticipantStats stats = device.participant().stats();
  const TrafficCounters& traffic = stats.traffic;
  report.session_id = device.participant().session().value();
  report.keyframes = stats.num_keyframes;
  report.keyframe_equivalents = device.num_keyframe_equivalents();
  report.keyframes_uploaded = stats.num_uploaded;
  report.keyframes_skipped = stats.num_skipped;
  report.keyframes_dropped = stats.num_dropped;
  report.keyframes_rejected = stats.num_rejected;
  report.aligned_at_keyframe = stats.aligned_at_keyframe;
  if (stats.num_overlaps > 0) report.overlap_mean = stats.overlap_sum / static_cast<double>(stats.num_overlaps);
  report.upload_bytes = traffic.upload_bytes + traffic.report_bytes;
  report.full_bytes = stats.full_bytes + device.keyframe_equivalent_bytes();
  report.query_bytes = traffic.max_query_bytes;
  if (traffic.num_queries > 0) {
    report.response_bytes_mean = static_cast<double>(traffic.response_bytes) / static_cast<double>(traffic.num_queries);
  }
  report.download_bytes = traffic.download_bytes;
  report.shared_map_requests = traffic.num_shared_map_requests;
  report.sharing_failures = stats.num_sharing_failures;
  report.update_reports = stats.num_update_reports;
  report.retries = traffic.num_retries;
  report.local_mapping_ms_total = device.tracker().local_mapping_ms();
}

/// Too few frames to align is a fact about the run, reported as "no figure", not a failure of it.
std::optional<double> RmseIfPaired(const StatusOr<TrajectoryError>& error) {
  if (!error.ok()) return std::nullopt;
  return error->rmse_m;
}

void FillErrors(const Sequence& sequence, const SessionTrajectory& trajectory, const std::optional<Sim3>& joint,
                ReplayReport& report) {
  const std::vector<StampedPose>& truth = sequence.ground_truth();
  if (truth.empty()) return;
  report.ate_m = RmseIfPaired(AbsoluteTrajectoryError(truth, trajectory.Stamped(), /*with_scale=*/false));
  if (joint && trajectory.in_map) {
    report.ate_joint_m = RmseIfPaired(TrajectoryErrorUnder(*joint, truth, trajectory.Stamped()));
  }
}

FrameLog MakeFrameLog(uint64_t session_id, const SessionTrajectory& trajectory,
                      const std::vector<PlayedFrame>& frames) {
  std::map<int64_t, FrameRole> roles;
  for (const PlayedFrame& frame : frames) roles[frame.stamp_ns] = frame.role;
  FrameLog log{session_id, {}};
  for (const TrajectoryPose& pose : trajectory.poses) {
    log.frames.push_back({pose.stamp_ns, pose.T_session_camera, pose.on_shared_map, roles[pose.stamp_ns]});
  }
  return log;
}

Status WriteTrajectory(const std::string& file, const SessionTrajectory& trajectory, std::ostream& out) {
  MAPP_RETURN_IF_ERROR(WriteTumTrajectory(file, trajectory.Stamped()));
  if (trajectory.in_map) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::string poses, ReadInput(file));
  return WriteOutput(file, "# T_session_camera: the session was never aligned with the map\n" + poses, out);
}

Status WriteFiles(const ReplayOptions& options, const Sequence& sequence, const ReplayReport& report,
                  const SessionTrajectory& trajectory, const std::vector<PlayedFrame>& frames, std::ostream& out) {
  if (!options.truth_file.empty() && !sequence.ground_truth().empty()) {
    MAPP_RETURN_IF_ERROR(WriteTumTrajectory(options.truth_file, sequence.ground_truth()));
  }
  if (!options.trajectory_file.empty()) {
    MAPP_RETURN_IF_ERROR(WriteTrajectory(options.trajectory_file, trajectory, out));
  }
  if (!options.frames_file.empty() && trajectory.in_map) {
    const FrameLog log = MakeFrameLog(report.session_id, trajectory, frames);
    MAPP_RETURN_IF_ERROR(WriteOutput(options.frames_file, FormatFrameLog(log), out));
  }
  if (!options.json_file.empty()) {
    MAPP_RETURN_IF_ERROR(WriteOutput(options.json_file, FormatJson(report), out));
  }
  return absl::OkStatus();
}

/// What became of the session as a whole. Keyframes that did not arrive explain the troubles that followed.
Status Outcome(const Status& played, const Status& closed, const ParticipantStats& stats) {
  if (stats.num_rejected > 0 || stats.num_dropped > 0) {
    return absl::AbortedError(fmt::format("{} of {} keyframes did not reach the map, the last error being: {}",
                                          stats.num_rejected + stats.num_dropped, stats.num_keyframes,
                                          stats.last_error));
  }
  MAPP_RETURN_IF_ERROR(played);
  return Annotate(closed, "closing the session");
}

StatusOr<std::unique_ptr<Device>> OpenDevice(const ReplayOptions& options, const Sequence& sequence) {
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<OrbTracker> tracker, MakeTracker(sequence));
  MapClientOptions client_options;
  client_options.server_address = options.server;
  ParticipantOptions participant_options;
  participant_options.map_name = options.map_name;
  participant_options.device = options.device;
  participant_options.policy = options.policy;
  return Device::Open(std::move(tracker), client_options, participant_options);
}

}  // namespace

Status RunReplay(const ReplayOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Sequence> sequence, OpenSequenceSource(options.sequence));
  MAPP_ASSIGN_OR_RETURN(const std::optional<Sim3> joint, JointAlignment(options, *sequence));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Device> device, OpenDevice(options, *sequence));

  const auto start = std::chrono::steady_clock::now();
  const PlayedFrames played = Play(*sequence, options.rate, options.patience, stop, *device);
  Status closed = device->Close(options.patience, /*wait_for_optimization=*/true);

  ReplayReport report;
  report.sequence = options.sequence;
  report.map = options.map_name;
  report.device = options.device;
  report.policy = options.policy == UploadPolicy::kMap ? "map" : "upload_all";
  // A server that is killed while it optimizes forgets to; the session's own data are safe.
  report.optimization_pending =
      absl::IsDeadlineExceeded(closed) && device->participant().state() == ParticipantState::kClosed;
  if (report.optimization_pending) closed = absl::OkStatus();
  report.interrupted = absl::IsCancelled(played.status);
  report.duration_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const SessionTrajectory trajectory = TrajectoryOf(*device);
  FillFrames(played.frames, report);
  FillParticipation(*device, report);
  FillErrors(*sequence, trajectory, joint, report);
  MAPP_RETURN_IF_ERROR(WriteFiles(options, *sequence, report, trajectory, played.frames, out));
  if (options.json_file != "-") out << FormatText(report);

  return Outcome(played.status, closed, device->participant().stats());
}

}  // namespace mapp
