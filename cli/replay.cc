#include "cli/replay.h"

#include "cli/admin_client.h"
#include "cli/frame_log.h"
#include "cli/replay_figures.h"
#include "cli/replay_player.h"
#include "cli/replay_report.h"
#include "cli/replay_source.h"
#include "datasets/sequence.h"
#include "eval/harness/choices.h"
#include "eval/metrics/trajectory_metrics.h"
#include "mapp/base/process_usage.h"
#include "text/file_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

namespace mapp {
namespace {

/// The device's poses, in the map's frame where a fragment is aligned.
struct DeviceTrajectory {
  bool in_map = false;
  bool metric = true;  ///< else lengths are in a unit of the map's, or of the fragment's own
  /// T_map_camera when `in_map`, with the map's corrections to the keyframes; else T_session_camera.
  std::vector<TrajectoryPose> poses;

  std::vector<StampedPose> Stamped() const {
    std::vector<StampedPose> stamped;
    for (const TrajectoryPose& pose : poses) stamped.push_back({pose.stamp_ns, pose.T_session_camera});
    return stamped;
  }
};

/// `metric`: the device's lengths are metres.
StatusOr<DeviceTrajectory> TrajectoryOf(const ReplayOptions& options, const std::vector<DeviceFragment>& fragments,
                                        bool metric) {
  if (auto in_map = TrajectoryInMap(fragments)) {
    if (metric) return DeviceTrajectory{true, true, std::move(*in_map)};
    MAPP_ASSIGN_OR_RETURN(const MapSummary map, AdminClient(options.server).GetMap(options.map_name));
    return DeviceTrajectory{true, !map.scale_unknown, std::move(*in_map)};
  }
  // Each has a frame of its own: they cannot stand in one trajectory.
  const auto num_frames = [](const DeviceFragment& fragment) { return fragment.trajectory.size(); };
  return DeviceTrajectory{false, metric, std::ranges::max_element(fragments, {}, num_frames)->trajectory};
}

/// Frames on which a tracker proved its map turn out to have been tracked only once it had.
void MarkTracked(const std::vector<DeviceFragment>& fragments, std::vector<PlayedFrame>& frames) {
  std::set<int64_t> tracked_ns;
  for (const DeviceFragment& fragment : fragments) {
    for (const TrajectoryPose& pose : fragment.trajectory) tracked_ns.insert(pose.stamp_ns);
  }
  for (PlayedFrame& frame : frames) frame.tracked = tracked_ns.contains(frame.stamp_ns);
}

/// The alignment of truth and map as the map's first session gives it, `with_scale` where the map tells no metres.
StatusOr<std::optional<Sim3>> JointAlignment(const ReplayOptions& options, const ReplaySource& source,
                                             bool with_scale) {
  if (!options.align_by) return std::optional<Sim3>();
  if (source.ground_truth().empty()) {
    return absl::InvalidArgumentError(fmt::format("--align-by: {} has no ground truth", source.name()));
  }
  MAPP_ASSIGN_OR_RETURN(const auto truth, ReadTumTrajectory(options.align_by->truth_file));
  MAPP_ASSIGN_OR_RETURN(const auto trajectory, ReadTumTrajectory(options.align_by->trajectory_file));
  StatusOr<TrajectoryError> error = AbsoluteTrajectoryError(truth, trajectory, with_scale);
  if (!error.ok()) return Annotate(error.status(), "--align-by");
  return std::optional<Sim3>(error->T_truth_estimate);
}

/// Too few frames to align is a fact about the run, reported as "no figure", not a failure of it.
std::optional<double> RmseIfPaired(const StatusOr<TrajectoryError>& error) {
  if (!error.ok()) return std::nullopt;
  return error->rmse_m;
}

ReplayErrors ErrorsOf(const DeviceTrajectory& trajectory, const std::vector<StampedPose>& truth,
                      const std::optional<Sim3>& joint) {
  const std::vector<StampedPose> poses = trajectory.Stamped();
  const auto error = AbsoluteTrajectoryError(truth, poses, /*with_scale=*/!trajectory.metric);
  ReplayErrors errors;
  errors.ate_m = RmseIfPaired(error);
  if (error.ok() && !trajectory.metric) errors.ate_scale = error->T_truth_estimate.scale;
  if (joint && trajectory.in_map) {
    const auto joint_error = TrajectoryErrorUnder(*joint, truth, poses);
    errors.ate_joint_m = RmseIfPaired(joint_error);
    if (joint_error.ok()) errors.max_joint_error_m = joint_error->max_m;
  }
  return errors;
}

/// The sessions that this one is to be judged with.
StatusOr<std::vector<JudgedTrajectory>> ReadOthers(const ReplayOptions& options, const ReplaySource& source) {
  std::vector<JudgedTrajectory> others;
  if (!options.together_with.empty() && source.ground_truth().empty()) {
    return absl::InvalidArgumentError(fmt::format("--together-with: {} has no ground truth", source.name()));
  }
  for (const TrajectoryFiles& files : options.together_with) {
    JudgedTrajectory& other = others.emplace_back();
    MAPP_ASSIGN_OR_RETURN(other.truth, ReadTumTrajectory(files.truth_file));
    MAPP_ASSIGN_OR_RETURN(other.estimate, ReadTumTrajectory(files.trajectory_file));
  }
  return others;
}

/// Of the aligned fragments.
std::vector<FrameLog> MakeFrameLogs(const std::vector<DeviceFragment>& fragments,
                                    const std::vector<PlayedFrame>& frames) {
  std::map<int64_t, FrameRole> roles;
  for (const PlayedFrame& frame : frames) roles[frame.stamp_ns] = frame.role;
  std::vector<FrameLog> logs;
  for (const DeviceFragment& fragment : fragments) {
    if (!fragment.session.T_map_session) continue;
    FrameLog& log = logs.emplace_back();
    log.session_id = fragment.session.session->value();
    for (const TrajectoryPose& pose : TrajectoryInMap(fragment)) {
      log.frames.push_back({pose.stamp_ns, pose.T_session_camera, pose.on_shared_map, roles[pose.stamp_ns]});
    }
  }
  return logs;
}

Status WriteTrajectory(const std::string& file, const DeviceTrajectory& trajectory, std::ostream& out) {
  MAPP_RETURN_IF_ERROR(WriteTumTrajectory(file, trajectory.Stamped()));
  if (trajectory.in_map) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::string poses, ReadInput(file));
  const char* const unit = trajectory.metric ? "" : "# its lengths are in a unit of its own: scale unknown\n";
  return WriteOutput(
      file, fmt::format("# T_session_camera of the longest fragment: none was aligned with the map\n{}{}", unit, poses),
      out);
}

Status WriteFiles(const ReplayOptions& options, const ReplaySource& source, const ReplayReport& report,
                  const DeviceTrajectory& trajectory, const std::vector<FrameLog>& logs, std::ostream& out) {
  if (!options.truth_file.empty() && !source.ground_truth().empty()) {
    MAPP_RETURN_IF_ERROR(WriteTumTrajectory(options.truth_file, source.ground_truth()));
  }
  if (!options.trajectory_file.empty()) {
    MAPP_RETURN_IF_ERROR(WriteTrajectory(options.trajectory_file, trajectory, out));
  }
  if (!options.frames_file.empty() && !logs.empty()) {
    MAPP_RETURN_IF_ERROR(WriteOutput(options.frames_file, FormatFrameLogs(logs), out));
  }
  if (!options.json_file.empty()) {
    MAPP_RETURN_IF_ERROR(WriteOutput(options.json_file, FormatJson(report), out));
  }
  return absl::OkStatus();
}

ReplayReport DescribeRun(const ReplayOptions& options) {
  ReplayReport report;
  report.sequence = options.sequence;
  report.map = options.map_name;
  report.device = options.device;
  report.policy = NameOf(kPolicyChoices, options.participation.policy);
  report.sampler = NameOf(kSamplerChoices, options.participation.sampler);
  report.injection = NameOf(kInjectionChoices, options.participation.injection);
  report.sharing = options.participation.sharing;
  report.alpha = options.participation.oversharing;
  report.look_ahead_m = options.participation.look_ahead_m;
  return report;
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

StatusOr<std::unique_ptr<ReplayDevice>> OpenDevice(const ReplayOptions& options, const ReplaySource& source) {
  MapClientOptions client_options;
  client_options.server_address = options.server;
  ParticipantOptions participant_options = options.participation;
  participant_options.map_name = options.map_name;
  participant_options.device = options.device;
  return source.Open(client_options, participant_options);
}

}  // namespace

Status RunReplay(const ReplayOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<ReplaySource> source, OpenReplaySource(options.sequence, options.level));
  return RunReplay(options, *source, stop, out);
}

Status RunReplay(const ReplayOptions& options, const ReplaySource& source, const std::stop_token& stop,
                 std::ostream& out) {
  // Before anything is played: files may be at fault.
  MAPP_ASSIGN_OR_RETURN(std::optional<Sim3> joint, JointAlignment(options, source, /*with_scale=*/false));
  MAPP_ASSIGN_OR_RETURN(std::vector<JudgedTrajectory> judged_with, ReadOthers(options, source));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<ReplayDevice> device, OpenDevice(options, source));

  const auto start = std::chrono::steady_clock::now();
  const double cpu_before_s = GetProcessUsage().cpu_s;
  PlayedFrames played = Play(source, options.rate, options.patience, stop, *device);
  Status closed = device->Close(options.patience, /*wait_for_optimization=*/true);

  ReplayReport report = DescribeRun(options);
  std::vector<DeviceFragment> fragments = device->fragments();
  // A server that is killed while it optimizes forgets to; the session's own data are safe.
  report.optimization_pending =
      absl::IsDeadlineExceeded(closed) && std::ranges::all_of(fragments, [](const DeviceFragment& fragment) {
        return fragment.session.state == ParticipantState::kClosed;
      });
  if (report.optimization_pending) closed = absl::OkStatus();
  report.interrupted = absl::IsCancelled(played.status);
  const ProcessUsage usage = GetProcessUsage();
  report.cpu.process_s = usage.cpu_s - cpu_before_s;
  report.peak_rss_bytes = usage.peak_rss_bytes;
  report.duration_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  MAPP_ASSIGN_OR_RETURN(const DeviceTrajectory uncorrected, TrajectoryOf(options, fragments, device->metric()));
  // A server that could not close the session is not asked once more.
  const Status fetched = closed.ok() ? device->FetchKeyframePoses(fragments) : absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const DeviceTrajectory trajectory, TrajectoryOf(options, fragments, device->metric()));
  if (!trajectory.metric) {
    MAPP_ASSIGN_OR_RETURN(joint, JointAlignment(options, source, /*with_scale=*/true));
  }
  MarkTracked(fragments, played.frames);
  FillFrames(played.frames, report);
  FillFragments(fragments, report);
  FillParticipation(*device, report);
  if (!source.ground_truth().empty()) {
    report.errors = ErrorsOf(trajectory, source.ground_truth(), joint);
    if (trajectory.in_map && !judged_with.empty()) {
      judged_with.push_back({source.ground_truth(), trajectory.Stamped()});
      report.ate_together_m = RmseIfPaired(TogetherTrajectoryError(judged_with));
    }
    report.uncorrected_errors = ErrorsOf(uncorrected, source.ground_truth(), joint);
  }
  MAPP_RETURN_IF_ERROR(WriteFiles(options, source, report, trajectory, MakeFrameLogs(fragments, played.frames), out));
  if (options.json_file != "-") out << FormatText(report);

  MAPP_RETURN_IF_ERROR(Outcome(played.status, closed, device->stats()));
  return Annotate(fetched, "asking for the poses of the keyframes");
}

}  // namespace mapp
