#include "cli/maps.h"

#include "cli/admin_client.h"
#include "cli/confirm.h"
#include "cli/geometry_json.h"
#include "cli/progress_bar.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

void AppendFields(const MapSummary& map, JsonWriter& json) {
  json.Field("id", map.id).Field("name", map.name).Field("created_unix_ns", map.created_unix_ns);
  json.Field("revision", map.revision).Field("num_frames", map.num_frames).Field("num_points", map.num_points);
  json.Field("num_sessions", map.num_sessions);
  json.Field("tile_edge_m", map.tile_edge_m).Field("cone_range_m", map.cone_range_m);
  json.Key("feature_settings");
  if (map.features) {
    json.BeginObject().Field("descriptor_kind", map.features->descriptor_kind);
    json.Field("scale_factor", map.features->scale_factor).Field("num_levels", map.features->num_levels);
    json.Field("patch_size_px", map.features->patch_size_px).EndObject();
  } else {
    json.Null();
  }
  json.Field("scale_unknown", map.scale_unknown);
}

std::string FormatJson(const std::vector<MapSummary>& maps) {
  JsonWriter json;
  json.BeginObject().Key("maps").BeginArray();
  for (const MapSummary& map : maps) {
    json.BeginObject();
    AppendFields(map, json);
    json.EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::vector<MapSummary>& maps) {
  TextTable table({{"name"},
                   {"sessions", Align::kRight},
                   {"frames", Align::kRight},
                   {"points", Align::kRight},
                   {"revision", Align::kRight},
                   {"unit"},
                   {"created (UTC)"}});
  for (const MapSummary& map : maps) {
    table.AddRow({map.name, std::to_string(map.num_sessions), std::to_string(map.num_frames),
                  std::to_string(map.num_points), std::to_string(map.revision), map.scale_unknown ? "unknown" : "m",
                  FormatUnixTime(map.created_unix_ns)});
  }
  return table.Format();
}

std::string FormatJson(const MapSummary& map) {
  JsonWriter json;
  json.BeginObject();
  AppendFields(map, json);
  json.Field("num_tiles", map.num_tiles).Key("bounds_m");
  if (map.bounds) {
    json.BeginObject();
    AppendPoint(map.bounds->min(), "min", json);
    AppendPoint(map.bounds->max(), "max", json);
    json.EndObject();
  } else {
    json.Null();
  }
  json.EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const MapSummary& map) {
  TextTable table({{"map"}, {map.name}});
  table.AddRow({"id", std::to_string(map.id)});
  table.AddRow({"created (UTC)", FormatUnixTime(map.created_unix_ns)});
  table.AddRow({"revision", std::to_string(map.revision)});
  table.AddRow({"unit of length", map.scale_unknown ? "unknown: no metre" : "m"});
  table.AddRow({"sessions", std::to_string(map.num_sessions)});
  table.AddRow({"frames", std::to_string(map.num_frames)});
  table.AddRow({"points", std::to_string(map.num_points)});
  table.AddRow({"tiles", fmt::format("{} of {} m", map.num_tiles, map.tile_edge_m)});
  table.AddRow({"view cone range", fmt::format("{} m", map.cone_range_m)});
  if (map.features) {
    table.AddRow(
        {"features", fmt::format("{}, scale factor {}, levels {}, patch {} px", map.features->descriptor_kind,
                                 map.features->scale_factor, map.features->num_levels, map.features->patch_size_px)});
  }
  if (map.bounds) {
    const Eigen::Vector3d size = map.bounds->sizes();
    table.AddRow({"extent", fmt::format("{:.1f} x {:.1f} x {:.1f} m", size.x(), size.y(), size.z())});
  }
  return table.Format();
}

}  // namespace

Status RunMapsList(const MapsListOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<MapSummary> maps, AdminClient(options.server).ListMaps());
  out << (options.json ? FormatJson(maps) : FormatText(maps));
  return absl::OkStatus();
}

Status RunMapsShow(const MapsShowOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const MapSummary map, AdminClient(options.server).GetMap(options.name, options.at));
  out << (options.json ? FormatJson(map) : FormatText(map));
  return absl::OkStatus();
}

Status RunMapsDelete(const MapsDeleteOptions& options, std::istream& in, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const MapSummary map, client.GetMap(options.name));
  const Question question{.text = fmt::format("Delete map {} with {} sessions, {} frames and {} points?", map.name,
                                              map.num_sessions, map.num_frames, map.num_points),
                          .doing = "deleting a map",
                          .not_done = "nothing was deleted",
                          .yes = options.yes,
                          .interactive = options.interactive};
  MAPP_RETURN_IF_ERROR(Confirm(question, in, out));
  MAPP_ASSIGN_OR_RETURN(const auto deleted, client.DeleteMap(options.name, options.force));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("name", options.name);
    json.Field("num_frames", deleted.first).Field("num_points", deleted.second).EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("deleted {}: {} frames, {} points\n", options.name, deleted.first, deleted.second);
  }
  return absl::OkStatus();
}

Status RunMapsOptimize(const MapsOptimizeOptions& options, const std::stop_token& stop, std::ostream& out) {
  // How many rounds it takes is known at the end: the bar tells of one.
  ProgressBar bar(fmt::format("optimize {}", options.name), 2);
  const auto show = [&bar](const MapOptimizationStep& step) {
    bar.Update(step.pass, fmt::format("{} frames, {} points, round {}, pass {} of 2, iteration {}", step.num_frames,
                                      step.num_points, step.round + 1, step.pass + 1, step.num_iterations));
  };
  MAPP_ASSIGN_OR_RETURN(const MapOptimizationSummary done,
                        AdminClient(options.server).OptimizeMap(options.name, show, stop));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("name", options.name).Field("applied", done.applied);
    json.Field("initial_rmse_px", done.initial_rmse_px).Field("final_rmse_px", done.final_rmse_px);
    json.Field("num_frames", uint64_t{done.num_frames}).Field("num_points", uint64_t{done.num_points});
    json.Field("num_rounds", uint64_t{done.num_rounds}).Field("num_fused", uint64_t{done.num_fused});
    json.Field("seconds", done.seconds).EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("{}: {} frames and {} points ({} fused), {:.3f} -> {:.3f} px, {} rounds in {:.1f} s{}\n",
                       options.name, done.num_frames, done.num_points, done.num_fused, done.initial_rmse_px,
                       done.final_rmse_px, done.num_rounds, done.seconds, done.applied ? "" : "; not adjusted");
  }
  return absl::OkStatus();
}

}  // namespace mapp
