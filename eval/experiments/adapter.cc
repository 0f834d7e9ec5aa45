// Recorded keyframes through the adapter: sessions of a foreign SLAM system, merged and optimised as one map.

#include "datasets/sequence.h"
#include "eval/adapter/odometry_mapper.h"
#include "eval/experiments/experiment.h"
#include "eval/harness/eval_server.h"
#include "eval/harness/figures.h"
#include "eval/metrics/statistics.h"
#include "eval/metrics/trajectory_metrics.h"
#include "mapp/client/participant.h"
#include "sim_device/odometry.h"
#include "text/file_io.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>

namespace mapp {
namespace {

namespace fs = std::filesystem;

constexpr char kMapName[] = "adapter";
constexpr size_t kNumSessions = 3;
constexpr int kNumRuns = 3;  ///< at full scale, each with a drift of its own
constexpr std::chrono::minutes kPatience{5};

/// After 10 m of a straight way the position is off by 1 % of it and the heading by half a degree, one sigma each.
sim::OdometryNoise Drift() {
  const double per_root_m = 1 / std::sqrt(10.0);
  return {.position_m = 0.1 / std::sqrt(3.0) * per_root_m,
          .yaw_rad = 0.5 * std::numbers::pi / 180 * per_root_m,
          .yaw_per_turn_rad = 0};
}

/// One run: a server, and the sessions cut from one recording.
class AdapterRun {
 public:
  AdapterRun(const EvalContext& context, const Sequence& sequence, const std::vector<StampedPose>& truth, uint64_t seed)
      : lab_(context.lab), sequence_(sequence), truth_(truth), seed_(seed) {}

  /// A row of the table.
  StatusOr<std::vector<Cell>> Run();

 private:
  struct Joint {
    size_t num_keyframes = 0;
    double ate_m = 0;
    std::vector<double> session_m;  ///< each session's in the frame of all
  };

  Status PlaySession(size_t session);
  StatusOr<Joint> Judge(const std::string& name) const;
  StatusOr<Figures> RunTool(std::vector<std::string> arguments, const std::string& name) const;

  const Lab& lab_;
  const Sequence& sequence_;
  const std::vector<StampedPose>& truth_;
  const uint64_t seed_;
  std::string folder_;
  std::unique_ptr<EvalServer> server_;
  std::vector<double> odometry_m_;  ///< per session, the ATE of what it was given
  size_t num_merged_ = 0;
};

StatusOr<Figures> AdapterRun::RunTool(std::vector<std::string> arguments, const std::string& name) const {
  const std::string output = fmt::format("{}/{}.json", folder_, name);
  ChildOptions child;
  child.command = {lab_.options().programs.mapp};
  child.command.insert(child.command.end(), arguments.begin(), arguments.end());
  child.command.insert(child.command.end(), {"--json", "--server", server_->address()});
  child.output_file = output;
  child.error_file = output + ".log";
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<ChildProcess> process, ChildProcess::Start(child));
  MAPP_RETURN_IF_ERROR(WaitFor(*process, "mapp " + arguments.front(), child.error_file, kPatience, lab_.stop()));
  MAPP_ASSIGN_OR_RETURN(const std::string text, ReadInput(output));
  return Figures::Parse(text, output);
}

Status AdapterRun::PlaySession(size_t session) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<OdometryMapper> slam, OdometryMapper::Create(sequence_, {}));
  MapClientOptions client;
  client.server_address = server_->address();
  ParticipantOptions options;
  options.map_name = kMapName;
  options.device = fmt::format("session_{}", session);
  options.policy = UploadPolicy::kUploadAll;
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Participant> participant,
                        Participant::Open(client, options, slam->camera(), SensorKind::kStereo, nullptr));

  sim::Odometry odometry(Drift(), seed_ * kNumSessions + session);
  const size_t end = (session + 1) * sequence_.num_frames() / kNumSessions;
  Pose3 T_world_before, T_session_camera;
  std::vector<StampedPose> given;
  for (size_t i = session * sequence_.num_frames() / kNumSessions; i < end; ++i) {
    if (lab_.stop().stop_requested()) return absl::CancelledError("interrupted");
    const Pose3 T_world_camera = truth_[i].T_world_camera * slam->T_left_camera();
    if (!given.empty()) {
      const Eigen::Vector3d up_before = T_world_before.rotation().conjugate() * Eigen::Vector3d::UnitZ();
      T_session_camera = T_session_camera * odometry.Measure(T_world_before.Inverse() * T_world_camera, up_before);
    }
    T_world_before = T_world_camera;
    MAPP_ASSIGN_OR_RETURN(const SequenceFrame images, sequence_.Read(i));
    MAPP_ASSIGN_OR_RETURN(Keyframe keyframe, slam->Add(images, T_session_camera));
    given.push_back({images.stamp_ns, T_session_camera});
    participant->OnKeyframe(std::move(keyframe));
  }
  MAPP_RETURN_IF_ERROR(participant->Close(kPatience, /*wait_for_optimization=*/true));
  if (participant->T_map_session()) ++num_merged_;
  MAPP_ASSIGN_OR_RETURN(const TrajectoryError error, AbsoluteTrajectoryError(truth_, given, /*with_scale=*/false));
  odometry_m_.push_back(error.rmse_m);
  return absl::OkStatus();
}

/// The map's keyframes of all sessions, under one alignment with the truth.
StatusOr<AdapterRun::Joint> AdapterRun::Judge(const std::string& name) const {
  const std::string trajectories = fmt::format("{}/{}", folder_, name);
  MAPP_RETURN_IF_ERROR(RunTool({"export", "--map", kMapName, "--format", "tum", "--out", trajectories}, name).status());
  std::vector<std::vector<StampedPose>> sessions;
  std::vector<StampedPose> all;
  std::error_code error;
  for (const fs::directory_entry& file : fs::directory_iterator(trajectories, error)) {
    MAPP_ASSIGN_OR_RETURN(sessions.emplace_back(), ReadTumTrajectory(file.path().string()));
    all.insert(all.end(), sessions.back().begin(), sessions.back().end());
  }
  if (error) return absl::InternalError(fmt::format("{}: {}", trajectories, error.message()));
  // Sessions follow each other in the recording.
  std::ranges::sort(sessions, {}, [](const auto& session) { return session.front().stamp_ns; });
  Joint joint;
  joint.num_keyframes = all.size();
  MAPP_ASSIGN_OR_RETURN(const TrajectoryError together, AbsoluteTrajectoryError(truth_, all, /*with_scale=*/false));
  joint.ate_m = together.rmse_m;
  for (const std::vector<StampedPose>& session : sessions) {
    MAPP_ASSIGN_OR_RETURN(const TrajectoryError own, TrajectoryErrorUnder(together.T_truth_estimate, truth_, session));
    joint.session_m.push_back(own.rmse_m);
  }
  return joint;
}

StatusOr<std::vector<Cell>> AdapterRun::Run() {
  folder_ = fmt::format("{}/adapter_{}", lab_.options().work_folder, seed_);
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", folder_, error.message()));
  MAPP_ASSIGN_OR_RETURN(server_, EvalServer::Start(lab_.options().programs, folder_, lab_.stop()));
  for (size_t session = 0; session < kNumSessions; ++session) {
    if (lab_.options().on_progress) {
      lab_.options().on_progress(fmt::format("seed {}: session {} of {}", seed_, session + 1, kNumSessions));
    }
    MAPP_RETURN_IF_ERROR(Annotate(PlaySession(session), fmt::format("session {}", session + 1)));
  }
  MAPP_ASSIGN_OR_RETURN(const Joint closed, Judge("closed"));
  MAPP_ASSIGN_OR_RETURN(const Figures optimized, RunTool({"maps", "optimize", kMapName}, "optimize"));
  MAPP_ASSIGN_OR_RETURN(const Joint whole, Judge("optimized"));
  MAPP_RETURN_IF_ERROR(server_->Stop(lab_.stop()));
  return std::vector<Cell>{static_cast<double>(seed_),
                           static_cast<double>(num_merged_),
                           static_cast<double>(whole.num_keyframes),
                           Mean(odometry_m_),
                           closed.ate_m,
                           whole.ate_m,
                           *std::ranges::max_element(whole.session_m),
                           Cell(optimized.Get("initial_rmse_px")),
                           Cell(optimized.Get("final_rmse_px")),
                           Cell(optimized.Get("num_fused")),
                           Cell(optimized.Get("seconds"))};
}

}  // namespace

StatusOr<ExperimentResult> RunAdapter(EvalContext& context) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Sequence> sequence, OpenSequence(context.recorded));
  const std::vector<StampedPose>& truth = sequence->ground_truth();
  if (truth.size() != sequence->num_frames() || truth.size() < 3 * kNumSessions) {
    return absl::InvalidArgumentError(
        fmt::format("{}: a true pose for each of at least {} frames is needed, got {} for {}", context.recorded,
                    3 * kNumSessions, truth.size(), sequence->num_frames()));
  }
  ExperimentResult result;
  result.setup = fmt::format("{}, {} stereo keyframes in {} sessions one after the other, uploaded whole.",
                             sequence->name(), sequence->num_frames(), kNumSessions);
  ResultTable table;
  table.id = "adapter";
  table.title = "Recorded keyframes through the adapter, all sessions in one frame";
  table.columns = {{"seed", 0},
                   {"sessions merged", 0},
                   {"keyframes in the map", 0},
                   {"odometry, mean ATE of a session, m", 4},
                   {"joint ATE, sessions closed, m", 4},
                   {"joint ATE, whole map optimized, m", 4},
                   {"worst session, m", 4},
                   {"before, px", 3},
                   {"after, px", 3},
                   {"points fused", 0},
                   {"optimization, s", 1}};
  const int num_runs = context.quick() ? 1 : kNumRuns;
  for (int run = 0; run < num_runs; ++run) {
    AdapterRun one(context, *sequence, truth, context.seed + static_cast<uint64_t>(run));
    MAPP_ASSIGN_OR_RETURN(table.rows.emplace_back(), one.Run());
  }
  result.tables.push_back(std::move(table));
  result.paper = "Not in the paper.";
  result.remarks = {
      "Sessions are consecutive thirds of the recording: no image is in two of them. Each has a frame of its own and "
      "is "
      "given the true motion with a random walk on it: one sigma of 1 % of the way and half a degree of heading after "
      "10 m. The adapter never corrects a pose.",
      "Errors are of all the map's keyframes under one alignment with the truth. The optimization is "
      "`mapp maps optimize`, once, after the last session has closed and been optimized itself."};
  return result;
}

}  // namespace mapp
