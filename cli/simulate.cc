#include "cli/simulate.h"

#include "cli/progress_bar.h"
#include "cli/simulation_json.h"
#include "cli/staged_folder.h"
#include "cli/world_image.h"
#include "sim/room.h"
#include "sim/world/world_files.h"
#include "text/file_io.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

size_t CountFrames(const sim::Simulation& simulation) {
  size_t num_frames = 0;
  for (const sim::Visit& visit : simulation.visits) num_frames += visit.poses.size();
  return num_frames;
}

Status WriteWorld(const sim::Simulation& simulation, const std::filesystem::path& folder, std::ostream& out) {
  const sim::World& world = *simulation.world;
  const int64_t first_ns = simulation.visits.front().poses.front().stamp_ns;
  MAPP_RETURN_IF_ERROR(sim::WriteMesh(sim::SceneAt(world, first_ns), (folder / "mesh.ply").string()));
  MAPP_RETURN_IF_ERROR(sim::WriteChanges(world, (folder / "changes.json").string()));
  MAPP_RETURN_IF_ERROR(WriteOutput((folder / "simulation.json").string(), FormatSimulation(simulation), out));
  MAPP_ASSIGN_OR_RETURN(const std::string preview, DrawWorld(simulation));
  return WriteOutput((folder / "preview.png").string(), preview, out);
}

Status WriteVisits(const std::shared_ptr<const sim::Simulation>& simulation, const sim::ImageOptions& images,
                   const std::filesystem::path& folder, const std::stop_token& stop) {
  ProgressBar bar("simulate", CountFrames(*simulation));
  size_t num_before = 0;
  for (const sim::Visit& visit : simulation->visits) {
    const std::string note = fmt::format("frames, user {} of {}", visit.user + 1, simulation->visits.size());
    const auto progress = [&](size_t num_written) {
      bar.Update(num_before + num_written, note);
      return !stop.stop_requested();
    };
    MAPP_RETURN_IF_ERROR(
        sim::WriteVisit(simulation, visit.user, images, (folder / VisitFolder(visit.user)).string(), progress));
    num_before += visit.poses.size();
  }
  return absl::OkStatus();
}

void Report(const SimulateOptions& options, const sim::Simulation& simulation, std::ostream& out) {
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("folder", options.folder).Field("setting", simulation.options.setting);
    json.Field("seed", simulation.options.seed).Field("num_users", simulation.visits.size());
    json.Field("num_frames", CountFrames(simulation));
    json.Field("num_changes", sim::ChangesOf(*simulation.world).size()).EndObject();
    out << std::move(json).Finish();
    return;
  }
  for (const sim::Visit& visit : simulation.visits) {
    out << fmt::format("{}/{}: {} frames, {:.0f} m, {}\n", options.folder, VisitFolder(visit.user), visit.poses.size(),
                       visit.path_m, visit.rig.name);
  }
  out << fmt::format("{}: {} frames of {} users in {}, seed {}\n", options.folder, CountFrames(simulation),
                     simulation.visits.size(), simulation.options.setting, simulation.options.seed);
}

}  // namespace

Status RunSimulate(const SimulateOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(StagedFolder folder, StagedFolder::Create(options.folder));
  MAPP_ASSIGN_OR_RETURN(const std::shared_ptr<const sim::Simulation> simulation, sim::Simulate(options.simulation));
  MAPP_RETURN_IF_ERROR(WriteWorld(*simulation, folder.path(), out));
  MAPP_RETURN_IF_ERROR(WriteVisits(simulation, options.images, folder.path(), stop));
  MAPP_RETURN_IF_ERROR(folder.Commit());
  Report(options, *simulation, out);
  return absl::OkStatus();
}

Status RunSimulateRoom(const SimulateRoomOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(StagedFolder folder, StagedFolder::Create(options.folder));
  sim::RoomOptions room;
  room.seed = options.room.seed;
  room.session = static_cast<int>(options.room.session);
  const size_t num_frames = sim::RoomTrajectory(room.session).size();
  {
    ProgressBar bar("simulate", num_frames);
    MAPP_RETURN_IF_ERROR(sim::WriteRoomSequence(folder.path().string(), room, [&](size_t num_written) {
      bar.Update(num_written, "frames");
      return !stop.stop_requested();
    }));
  }
  MAPP_RETURN_IF_ERROR(folder.Commit());
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("folder", options.folder).Field("seed", room.seed).Field("session", room.session);
    json.Field("num_frames", num_frames).EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("{}: {} frames of session {} in room {}\n", options.folder, num_frames, room.session, room.seed);
  }
  return absl::OkStatus();
}

}  // namespace mapp
