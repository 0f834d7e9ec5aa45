#pragma once

#include "cli/canvas.h"
#include "cli/map_info.h"
#include "mapp/base/status.h"

#include <ostream>
#include <span>
#include <string>

namespace mapp {

enum class ExportFormat {
  kPly,  ///< the map's points in one PLY file
  kTum,  ///< each session's keyframes in a TUM trajectory of its own
};
enum class PlyEncoding { kAscii, kBinary };

struct ExportOptions {
  std::string server;
  std::string map_name;
  std::string at;  ///< revision or tag; empty: now
  ExportFormat format = ExportFormat::kPly;
  PlyEncoding encoding = PlyEncoding::kBinary;
  /// PLY: the file, `-` for standard output. TUM: a folder, made when absent, which receives `session_<id>.txt`.
  std::string out;
  bool json = false;
};
/// `mapp export`: what the map holds, in its own frame. NOT_FOUND: no such map.
Status RunExport(const ExportOptions& options, std::ostream& out);

/// Points in the map's frame with `x y z` (metres), `observations`, `confidence` and `session` for each, and `red green
/// blue` where there are `colors`: one a point, or none.
std::string FormatPly(const MapContent& content, PlyEncoding encoding, std::span<const Color> colors = {});

}  // namespace mapp
