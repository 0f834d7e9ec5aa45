#include "cli/simulation_json.h"

#include "eval/harness/choices.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

constexpr int kFormatVersion = 1;

void WriteVector(const Eigen::Vector3d& vector, JsonWriter& json) {
  json.BeginArray().Value(vector.x()).Value(vector.y()).Value(vector.z()).EndArray();
}

void WriteOptions(const sim::SimulationOptions& options, JsonWriter& json) {
  json.Key("options").BeginObject();
  json.Field("setting", options.setting).Field("num_users", options.num_users).Field("path_m", options.path_m);
  json.Field("seed", options.seed).Key("cameras").BeginArray();
  for (const std::string& camera : options.cameras) json.Value(camera);
  json.EndArray().Field("sensor", NameOf(kSensorChoices, options.sensor)).Field("rate_hz", options.rate_hz);
  json.Field("num_changes", options.num_changes).Field("num_passers", options.num_passers);
  json.Field("change_reach_m", options.change_reach_m).Field("num_stable_visits", options.num_stable_visits);
  json.Key("change_kinds").BeginArray();
  for (const sim::ChangeKind kind : options.change_kinds) json.Value(NameOf(kChangeKindChoices, kind));
  json.EndArray();
  json.Field("max_duration_s", options.max_duration_s).Field("num_routes", options.num_routes);
  json.Field("textures_folder", options.textures_folder).Key("trajectory_files").BeginArray();
  for (const std::string& file : options.trajectory_files) json.Value(file);
  json.EndArray().EndObject();
}

}  // namespace

std::string VisitFolder(int user) { return fmt::format("user_{:03d}", user); }

std::string FormatSimulation(const sim::Simulation& simulation) {
  const sim::World& world = *simulation.world;
  JsonWriter json;
  json.BeginObject().Field("format_version", kFormatVersion);
  WriteOptions(simulation.options, json);
  json.Key("bounds_world").BeginObject().Key("min_m");
  WriteVector(world.bounds_world.min(), json);
  json.Key("max_m");
  WriteVector(world.bounds_world.max(), json);
  json.EndObject().Field("num_objects", world.objects.size()).Key("visits").BeginArray();
  for (const sim::Visit& visit : simulation.visits) {
    json.BeginObject().Field("user", visit.user).Field("folder", VisitFolder(visit.user));
    json.Field("camera", visit.rig.name).Field("sensor", NameOf(kSensorChoices, visit.rig.sensor));
    json.Field("rate_hz", visit.rig.rate_hz).Field("num_frames", visit.poses.size());
    json.Field("start_ns", visit.poses.front().stamp_ns).Field("end_ns", visit.poses.back().stamp_ns);
    json.Field("path_m", visit.path_m).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

}  // namespace mapp
