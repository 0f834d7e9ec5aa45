#include "sim/world/world_files.h"

#include "text/file_io.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <sstream>
#include <utility>

namespace mapp::sim {
namespace {

void AppendUint32(uint32_t value, std::string& bytes) {
  for (int i = 0; i < 4; ++i, value >>= 8) bytes += static_cast<char>(value & 0xFF);
}

void AppendVertex(const Eigen::Vector3d& p_world, std::string& bytes) {
  for (const double coordinate : p_world) AppendUint32(std::bit_cast<uint32_t>(static_cast<float>(coordinate)), bytes);
}

void AppendTriangle(const std::array<uint32_t, 3>& vertices, std::string& bytes) {
  bytes += static_cast<char>(3);
  for (const uint32_t vertex : vertices) AppendUint32(vertex, bytes);
}

const char* ChangeName(ChangeKind kind) {
  switch (kind) {
    case ChangeKind::kAppeared:
      return "appeared";
    case ChangeKind::kVanished:
      return "vanished";
    case ChangeKind::kMoved:
      return "moved";
  }
  return "";
}

void WriteVector(const Eigen::Vector3d& vector, JsonWriter& json) {
  json.BeginArray();
  for (const double value : vector) json.Value(value);
  json.EndArray();
}

void WriteBox(const std::optional<Pose3>& T_world_object, const Eigen::Vector3d& size_m, JsonWriter& json) {
  if (!T_world_object) {
    json.Null();
    return;
  }
  const Eigen::Vector3d x_world = T_world_object->rotation() * Eigen::Vector3d::UnitX();
  json.BeginObject().Key("center");
  WriteVector(T_world_object->translation(), json);
  json.Key("size");
  WriteVector(size_m, json);
  json.Field("yaw", std::atan2(x_world.y(), x_world.x())).EndObject();
}

/// `file` is a path here, never the standard output.
Status WriteWhole(const std::string& file, const std::string& content) {
  std::ostringstream unused;
  return WriteOutput(file == "-" ? "./-" : file, content, unused);
}

}  // namespace

Status WriteMesh(const Scene& scene, const std::string& file) {
  std::string ply = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment true surfaces, frame world, metres\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nelement face {}\n"
      "property list uchar uint vertex_indices\nend_header\n",
      4 * scene.quads.size(), 2 * scene.quads.size());
  for (const Quad& quad : scene.quads) {
    AppendVertex(quad.corner_world, ply);
    AppendVertex(quad.corner_world + quad.edge_v_world, ply);
    AppendVertex(quad.corner_world + quad.edge_v_world + quad.edge_u_world, ply);
    AppendVertex(quad.corner_world + quad.edge_u_world, ply);
  }
  for (uint32_t i = 0; i < scene.quads.size(); ++i) {
    AppendTriangle({4 * i, 4 * i + 1, 4 * i + 2}, ply);
    AppendTriangle({4 * i, 4 * i + 2, 4 * i + 3}, ply);
  }
  return WriteWhole(file, ply);
}

Status WriteChanges(const World& world, const std::string& file) {
  JsonWriter json;
  json.BeginObject().Field("setting", world.setting).Field("seed", world.seed).Key("changes").BeginArray();
  for (const WorldChange& change : ChangesOf(world)) {
    const WorldObject& object = world.objects.at(change.object_id - 1);
    json.BeginObject().Field("time_s", 1e-9 * static_cast<double>(change.stamp_ns));
    json.Field("stamp_ns", change.stamp_ns).Field("object", change.object_id);
    json.Field("kind", object.kind).Field("model", object.model).Field("change", ChangeName(change.kind));
    json.Key("before");
    WriteBox(change.T_world_object_before, object.size_m, json);
    json.Key("after");
    WriteBox(change.T_world_object_after, object.size_m, json);
    json.EndObject();
  }
  json.EndArray().EndObject();
  return WriteWhole(file, std::move(json).Finish());
}

}  // namespace mapp::sim
