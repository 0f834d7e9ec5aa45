#include "cli/export_map.h"

#include "cli/admin_client.h"
#include "datasets/sequence.h"
#include "mapp/base/check.h"
#include "text/file_io.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <bit>
#include <filesystem>
#include <iterator>
#include <map>

namespace mapp {
namespace {

template <typename T>
void AppendLittleEndian(T value, std::string& bytes) {
  uint32_t bits = std::bit_cast<uint32_t>(value);
  for (size_t i = 0; i < sizeof(bits); ++i, bits >>= 8) bytes += static_cast<char>(bits & 0xFF);
}

void AppendPointBinary(const MapPointSummary& point, const Color* color, std::string& bytes) {
  for (const double coordinate : point.p_map) AppendLittleEndian(static_cast<float>(coordinate), bytes);
  AppendLittleEndian(point.num_observations, bytes);
  AppendLittleEndian(point.confidence, bytes);
  AppendLittleEndian(static_cast<uint32_t>(point.session_id), bytes);
  if (color == nullptr) return;
  for (const uint8_t channel : {color->red, color->green, color->blue}) bytes += static_cast<char>(channel);
}

void AppendPointAscii(const MapPointSummary& point, const Color* color, std::string& text) {
  fmt::format_to(std::back_inserter(text), "{:.5f} {:.5f} {:.5f} {} {:.4f} {}", point.p_map.x(), point.p_map.y(),
                 point.p_map.z(), point.num_observations, point.confidence, point.session_id);
  if (color != nullptr) {
    fmt::format_to(std::back_inserter(text), " {} {} {}", color->red, color->green, color->blue);
  }
  text += '\n';
}

StatusOr<std::vector<std::string>> WriteTrajectories(const std::string& folder, const MapContent& content) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return absl::FailedPreconditionError(fmt::format("{}: cannot be made: {}", folder, error.message()));
  std::map<uint64_t, std::vector<StampedPose>> trajectories;
  for (const MapFrameSummary& frame : content.frames) {
    trajectories[frame.session_id].push_back({frame.stamp_ns, frame.T_map_camera});
  }
  std::vector<std::string> files;
  for (const auto& [session_id, poses] : trajectories) {
    files.push_back((std::filesystem::path(folder) / fmt::format("session_{}.txt", session_id)).string());
    MAPP_RETURN_IF_ERROR(WriteTumTrajectory(files.back(), poses));
  }
  return files;
}

void Report(const ExportOptions& options, const MapContent& content, const std::vector<std::string>& files,
            std::ostream& out) {
  if (!options.json) {
    out << fmt::format("{}: {} frames, {} points at revision {}\n", content.map.name, content.frames.size(),
                       content.points.size(), content.map.revision);
    for (const std::string& file : files) out << file << '\n';
    return;
  }
  JsonWriter json;
  json.BeginObject().Field("map", content.map.name).Field("revision", content.map.revision);
  json.Field("num_frames", content.frames.size()).Field("num_points", content.points.size());
  json.Key("files").BeginArray();
  for (const std::string& file : files) json.Value(file);
  json.EndArray().EndObject();
  out << std::move(json).Finish();
}

}  // namespace

std::string FormatPly(const MapContent& content, PlyEncoding encoding, std::span<const Color> colors) {
  MAPP_CHECK(colors.empty() || colors.size() == content.points.size());
  const bool ascii = encoding == PlyEncoding::kAscii;
  std::string ply = fmt::format(
      "ply\nformat {} 1.0\ncomment map points, frame map, metres\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uint observations\nproperty float confidence\nproperty uint session\n{}end_header\n",
      ascii ? "ascii" : "binary_little_endian", content.points.size(),
      colors.empty() ? "" : "property uchar red\nproperty uchar green\nproperty uchar blue\n");
  for (size_t i = 0; i < content.points.size(); ++i) {
    const Color* const color = colors.empty() ? nullptr : &colors[i];
    if (ascii) {
      AppendPointAscii(content.points[i], color, ply);
    } else {
      AppendPointBinary(content.points[i], color, ply);
    }
  }
  return ply;
}

Status RunExport(const ExportOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const MapContent content, AdminClient(options.server).ExportMap(options.map_name, options.at));
  std::vector<std::string> files = {options.out};
  if (options.format == ExportFormat::kPly) {
    MAPP_RETURN_IF_ERROR(WriteOutput(options.out, FormatPly(content, options.encoding), out));
  } else {
    MAPP_ASSIGN_OR_RETURN(files, WriteTrajectories(options.out, content));
  }
  // Standard output then carries the file itself.
  if (options.out != "-") Report(options, content, files, out);
  return absl::OkStatus();
}

}  // namespace mapp
