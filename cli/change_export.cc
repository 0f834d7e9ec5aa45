#include "cli/change_export.h"

#include "cli/box_outline.h"
#include "cli/change_text.h"
#include "cli/export_map.h"
#include "cli/geometry_json.h"
#include "cli/top_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

namespace mapp {
namespace {

/// The horizontal plane through the map's origin, with axes that follow the map's.
struct GroundPlane {
  explicit GroundPlane(const Eigen::Vector3d& up) : up_map(up) {
    // Along the map's x, unless that is steep: a map of a level camera has (x, z), and one whose z is up (x, y).
    constexpr double kSteep = 0.7;
    const Eigen::Vector3d forward_map = std::abs(up.x()) < kSteep ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
    u_map = (forward_map - forward_map.dot(up) * up).normalized();
    v_map = up.cross(u_map);
  }

  Eigen::Vector3d up_map;
  Eigen::Vector3d u_map, v_map;  ///< u, v and up are right-handed
};

void AppendRing(const OrientedBox& box_map, const GroundPlane& ground, JsonWriter& json) {
  std::vector<Eigen::Vector2d> corners;
  for (const Eigen::Vector3d& corner_map : CornersOf(box_map)) {
    corners.emplace_back(ground.u_map.dot(corner_map), ground.v_map.dot(corner_map));
  }
  std::vector<Eigen::Vector2d> ring = ConvexHull(std::move(corners));
  ring.push_back(ring.front());
  json.BeginArray();
  for (const Eigen::Vector2d& corner : ring) json.BeginArray().Value(corner.x()).Value(corner.y()).EndArray();
  json.EndArray();
}

/// The box with its outline on the ground and its heights; null without one.
void AppendGroundBox(const std::optional<OrientedBox>& box_map, const char* key, const GroundPlane& ground,
                     JsonWriter& json) {
  json.Key(key);
  if (!box_map) {
    json.Null();
    return;
  }
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Eigen::Vector3d& corner_map : CornersOf(*box_map)) {
    low = std::min(low, ground.up_map.dot(corner_map));
    high = std::max(high, ground.up_map.dot(corner_map));
  }
  json.BeginObject();
  AppendBoxFields(*box_map, json);
  json.Key("outline_m");
  AppendRing(*box_map, ground, json);
  json.Field("min_height_m", low).Field("max_height_m", high).EndObject();
}

std::string_view SuffixOf(std::string_view file) {
  const size_t dot = file.rfind('.');
  return dot == std::string_view::npos || file.find('/', dot) != std::string_view::npos ? "" : file.substr(dot);
}

}  // namespace

StatusOr<ChangeExportFormat> ChangeExportFormatOf(const std::string& file) {
  const std::string_view suffix = SuffixOf(file);
  if (suffix == ".json" || suffix == ".geojson") return ChangeExportFormat::kJson;
  if (suffix == ".ply") return ChangeExportFormat::kPly;
  return absl::InvalidArgumentError(fmt::format("{}: the name must end in .json, .geojson or .ply", file));
}

Status CheckPngName(const std::string& file) {
  if (file == "-" || SuffixOf(file) == ".png") return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: the name must end in .png", file));
}

std::string FormatChangeFeatures(const MapContent& map, const std::vector<ChangeSummary>& changes) {
  std::vector<Pose3> T_map_cameras;
  for (const MapFrameSummary& frame : map.frames) T_map_cameras.push_back(frame.T_map_camera);
  const GroundPlane ground(EstimateUp(T_map_cameras));
  JsonWriter json;
  json.BeginObject().Field("type", "FeatureCollection").Field("format_version", 1);
  json.Field("map", map.map.name).Field("revision", map.map.revision).Field("scale_unknown", map.map.scale_unknown);
  json.Key("ground").BeginObject();
  AppendPoint(ground.u_map, "u_map", json);
  AppendPoint(ground.v_map, "v_map", json);
  AppendPoint(ground.up_map, "up_map", json);
  json.EndObject().Key("features").BeginArray();
  for (const ChangeSummary& change : changes) {
    json.BeginObject().Field("type", "Feature").Field("id", change.id);
    json.Key("geometry").BeginObject().Field("type", "Polygon").Key("coordinates").BeginArray();
    AppendRing(LatestBox(change), ground, json);
    json.EndArray().EndObject().Key("properties").BeginObject();
    AppendChangeFields(change, json);
    AppendGroundBox(change.box_map_before, "box_before", ground, json);
    AppendGroundBox(change.box_map_after, "box_after", ground, json);
    json.EndObject().EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatChangedPly(const ChangedMap& map) {
  const PointRoles roles(map.changes);
  MapContent content;
  content.points = PointsAt(map, MapMoment::kBoth);
  std::vector<Color> colors;
  for (const MapPointSummary& point : content.points) colors.push_back(ColorOf(roles.Of(point.id)));
  return FormatPly(content, PlyEncoding::kBinary, colors);
}

}  // namespace mapp
