#include "eval/harness/lab.h"

#include "datasets/sequence.h"
#include "eval/harness/eval_server.h"
#include "eval/harness/point_cloud.h"
#include "eval/harness/visit_name.h"
#include "eval/metrics/reconstruction_metrics.h"
#include "eval/metrics/trajectory_metrics.h"
#include "sim/scene_rays.h"
#include "text/file_io.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

namespace mapp {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kToolTimeout{120};

/// Files of one device's run.
struct RunFiles {
  explicit RunFiles(const std::string& prefix)
      : json(prefix + ".json"),
        trajectory(prefix + ".traj"),
        truth(prefix + ".truth"),
        output(prefix + ".txt"),
        log(prefix + ".log") {}
  std::string json, trajectory, truth, output, log;
};

}  // namespace

StatusOr<Programs> FindPrograms() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  if (error) return absl::InternalError(fmt::format("/proc/self/exe: {}", error.message()));
  Programs programs{(folder / "mapp").string(), (folder / "mapp-server").string()};
  for (const std::string& program : {programs.mapp, programs.mapp_server}) {
    if (!fs::exists(program)) return absl::NotFoundError(fmt::format("{}: not there; build it first", program));
  }
  return programs;
}

struct Lab::Impl {
  explicit Impl(const Lab& owner) : lab(owner) {}

  const Lab& lab;
  std::map<std::string, std::shared_ptr<const FleetFigures>> fleets;
  std::map<std::string, std::shared_ptr<const sim::Simulation>> worlds;
  int num_runs = 0;
  mutable std::mutex progress_mutex;

  /// One fleet on one server.
  struct Stage {
    const FleetSpec& spec;
    std::string folder;
    std::unique_ptr<EvalServer> server;
    std::shared_ptr<const sim::Simulation> simulation;
    std::optional<Sim3> T_truth_map;
  };

  const Programs& programs() const { return lab.options_.programs; }

  RunFiles FilesOf(const Stage& stage, size_t device) const {
    return RunFiles(fmt::format("{}/device_{:03d}", stage.folder, device));
  }

  std::string NameOf(const Stage& stage, size_t device) const {
    return fmt::format("device {} ({})", device, stage.spec.devices[device].policy);
  }

  TileCacheOptions CacheOf(const Stage& stage, size_t device) const {
    const std::string& name = stage.spec.devices[device].tile_cache;
    return {.folder = name.empty() ? "" : fmt::format("{}/tiles_{}", stage.folder, name)};
  }

  /// Plays one device to its end.
  Status PlayDevice(const Stage& stage, size_t device) const {
    Tell(stage.spec, device);
    if (stage.spec.level == Level::kFeatures) return PlayFeatures(stage, device);
    const RunFiles files = FilesOf(stage, device);
    ChildOptions child;
    child.command = {programs().mapp,
                     "replay",
                     "--server",
                     stage.server->address(),
                     "--map",
                     kEvalMapName,
                     "--device",
                     fmt::format("device_{}", device),
                     "--json",
                     files.json,
                     "--trajectory-out",
                     files.trajectory,
                     "--truth-out",
                     files.truth,
                     "--patience",
                     fmt::format("{}", lab.options_.session_timeout / std::chrono::seconds(1))};
    const auto policy = ReplayArguments(PolicyNamed(stage.spec.devices[device].policy).participation);
    child.command.insert(child.command.end(), policy.begin(), policy.end());
    const TileCacheOptions cache = CacheOf(stage, device);
    if (!cache.folder.empty()) child.command.insert(child.command.end(), {"--tile-cache", cache.folder});
    if (IsJudgedByFirst(stage, device)) {
      const RunFiles first = FilesOf(stage, 0);
      child.command.insert(child.command.end(), {"--align-by", first.truth, first.trajectory});
    }
    child.command.push_back(VisitName(stage.spec.world, stage.spec.devices[device].visit));
    child.output_file = files.output;
    child.error_file = files.log;
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<ChildProcess> process, ChildProcess::Start(child));
    return WaitFor(*process, NameOf(stage, device), files.log, lab.options_.session_timeout, lab.stop_);
  }

  Status PlayFeatures(const Stage& stage, size_t device) const {
    const RunFiles files = FilesOf(stage, device);
    FeatureRun run;
    run.server = stage.server->address();
    run.map_name = kEvalMapName;
    run.device = fmt::format("device_{}", device);
    run.participation = PolicyNamed(stage.spec.devices[device].policy).participation;
    run.participation.tile_cache = CacheOf(stage, device);
    run.simulation = stage.simulation;
    run.visit = stage.spec.devices[device].visit;
    run.patience = lab.options_.session_timeout;
    run.json_file = files.json;
    run.trajectory_file = files.trajectory;
    run.truth_file = files.truth;
    if (IsJudgedByFirst(stage, device)) {
      run.first_truth_file = FilesOf(stage, 0).truth;
      run.first_trajectory_file = FilesOf(stage, 0).trajectory;
    }
    return Annotate(lab.options_.play_features(run, lab.stop_), NameOf(stage, device));
  }

  /// The first session's trajectory must be complete before others can be judged in its frame.
  static bool IsJudgedByFirst(const Stage& stage, size_t device) { return device > 0 && !stage.spec.concurrent; }

  /// Runs a tool of the command line to its end.
  Status RunTool(const Stage& stage, const std::vector<std::string>& arguments, const std::string& output) const {
    ChildOptions child;
    child.command = {programs().mapp};
    child.command.insert(child.command.end(), arguments.begin(), arguments.end());
    child.command.insert(child.command.end(), {"--server", stage.server->address()});
    child.output_file = output;
    child.error_file = output + ".log";
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<ChildProcess> process, ChildProcess::Start(child));
    return WaitFor(*process, "mapp " + arguments.front(), child.error_file, kToolTimeout, lab.stop_);
  }

  StatusOr<DeviceFigures> ReadDevice(const Stage& stage, size_t device) const {
    const RunFiles files = FilesOf(stage, device);
    DeviceFigures figures;
    MAPP_ASSIGN_OR_RETURN(const std::string report, ReadInput(files.json));
    MAPP_ASSIGN_OR_RETURN(figures.report, Figures::Parse(report, files.json));
    const std::string info_file = fmt::format("{}/server_{:03d}.json", stage.folder, device);
    MAPP_RETURN_IF_ERROR(RunTool(stage, {"server-info", "--json"}, info_file));
    MAPP_ASSIGN_OR_RETURN(const std::string info, ReadInput(info_file));
    MAPP_ASSIGN_OR_RETURN(figures.server, Figures::Parse(info, info_file));
    MAPP_ASSIGN_OR_RETURN(figures.server_usage, stage.server->Usage());
    return figures;
  }

  /// The map's frame is the first session's; its truth tells where that stands in the world.
  Status FindMapFrame(Stage& stage) const {
    const RunFiles files = FilesOf(stage, 0);
    MAPP_ASSIGN_OR_RETURN(const auto truth, ReadTumTrajectory(files.truth));
    MAPP_ASSIGN_OR_RETURN(const auto trajectory, ReadTumTrajectory(files.trajectory));
    MAPP_ASSIGN_OR_RETURN(const TrajectoryError error,
                          AbsoluteTrajectoryError(truth, trajectory, /*with_scale=*/false));
    stage.T_truth_map = error.T_truth_estimate;
    return absl::OkStatus();
  }

  StatusOr<ReconstructionError> Reconstruct(const Stage& stage, size_t device) const {
    const std::string file = fmt::format("{}/map_{:03d}.ply", stage.folder, device);
    MAPP_RETURN_IF_ERROR(RunTool(stage, {"export", "--map", kEvalMapName, "--ascii", "--out", file}, file + ".txt"));
    MAPP_ASSIGN_OR_RETURN(const std::vector<Eigen::Vector3d> p_map, ReadAsciiPly(file));
    const sim::Visit& visit = stage.simulation->visits.at(static_cast<size_t>(stage.spec.devices[device].visit));
    const sim::SceneRays truth(
        std::make_shared<const sim::Scene>(sim::SceneAt(*stage.simulation->world, visit.poses.front().stamp_ns)));
    return MeasureReconstruction(p_map, *stage.T_truth_map,
                                 [&](const Eigen::Vector3d& p_world) { return truth.DistanceToSurface(p_world); });
  }

  StatusOr<DeviceFigures> JudgeDevice(Stage& stage, size_t device) const {
    MAPP_ASSIGN_OR_RETURN(DeviceFigures figures, ReadDevice(stage, device));
    if (!stage.spec.reconstruct) return figures;
    if (!stage.T_truth_map) MAPP_RETURN_IF_ERROR(FindMapFrame(stage));
    MAPP_ASSIGN_OR_RETURN(figures.reconstruction, Reconstruct(stage, device));
    return figures;
  }

  void Tell(const FleetSpec& spec, size_t device) const {
    if (!lab.options_.on_progress) return;
    const std::lock_guard lock(progress_mutex);
    lab.options_.on_progress(fmt::format("{}, {}: device {} of {}, {}", spec.world.setting, LevelName(spec.level),
                                         device + 1, spec.devices.size(),
                                         PolicyNamed(spec.devices[device].policy).title));
  }

  Status PlayInTurn(Stage& stage, FleetFigures& figures) const {
    for (size_t device = 0; device < stage.spec.devices.size(); ++device) {
      MAPP_RETURN_IF_ERROR(PlayDevice(stage, device));
      MAPP_ASSIGN_OR_RETURN(DeviceFigures judged, JudgeDevice(stage, device));
      figures.devices.push_back(std::move(judged));
    }
    return absl::OkStatus();
  }

  Status PlayTogether(Stage& stage, FleetFigures& figures) const {
    std::vector<Status> outcomes(stage.spec.devices.size());
    {
      std::vector<std::jthread> devices;
      for (size_t device = 0; device < outcomes.size(); ++device) {
        devices.emplace_back([&, device] { outcomes[device] = PlayDevice(stage, device); });
      }
    }
    for (size_t device = 0; device < outcomes.size(); ++device) {
      MAPP_RETURN_IF_ERROR(outcomes[device]);
      MAPP_ASSIGN_OR_RETURN(DeviceFigures judged, JudgeDevice(stage, device));
      figures.devices.push_back(std::move(judged));
    }
    return absl::OkStatus();
  }

  StatusOr<std::shared_ptr<const sim::Simulation>> World(const sim::SimulationOptions& options) {
    const std::string key = VisitName(options, 0);
    auto& world = worlds[key];
    if (world == nullptr) {
      MAPP_ASSIGN_OR_RETURN(world, sim::Simulate(options));
    }
    return world;
  }

  StatusOr<std::shared_ptr<const FleetFigures>> Play(const FleetSpec& spec) {
    const auto start = std::chrono::steady_clock::now();
    Stage stage{spec, fmt::format("{}/run_{:03d}", lab.options_.work_folder, num_runs++), nullptr, nullptr, {}};
    std::error_code error;
    fs::create_directories(stage.folder, error);
    if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", stage.folder, error.message()));
    MAPP_ASSIGN_OR_RETURN(stage.simulation, World(spec.world));
    MAPP_ASSIGN_OR_RETURN(stage.server, EvalServer::Start(programs(), stage.folder, lab.stop_));
    auto figures = std::make_shared<FleetFigures>();
    MAPP_RETURN_IF_ERROR(spec.concurrent ? PlayTogether(stage, *figures) : PlayInTurn(stage, *figures));
    MAPP_RETURN_IF_ERROR(stage.server->Stop(lab.stop_));
    figures->database = stage.server->database();
    figures->first_truth_file = FilesOf(stage, 0).truth;
    figures->first_trajectory_file = FilesOf(stage, 0).trajectory;
    figures->database_bytes = fs::file_size(figures->database, error);
    figures->duration_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return std::shared_ptr<const FleetFigures>(std::move(figures));
  }
};

Lab::Lab(LabOptions options, std::stop_token stop)
    : options_(std::move(options)), stop_(std::move(stop)), impl_(std::make_unique<Impl>(*this)) {}

Lab::~Lab() = default;

StatusOr<std::shared_ptr<const FleetFigures>> Lab::Run(const FleetSpec& spec) {
  auto& known = impl_->fleets[spec.Key()];
  if (known == nullptr) {
    MAPP_ASSIGN_OR_RETURN(known, impl_->Play(spec));
  }
  return known;
}

StatusOr<std::shared_ptr<const sim::Simulation>> Lab::WorldOf(const sim::SimulationOptions& options) {
  return impl_->World(options);
}

}  // namespace mapp
