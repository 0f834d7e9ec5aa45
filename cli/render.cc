#include "cli/render.h"

#include "cli/admin_client.h"
#include "cli/frame_log.h"
#include "text/file_io.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {

Status RunRender(const RenderOptions& options, std::ostream& out) {
  MapImageContent content;
  for (const std::string& file : options.frame_files) {
    MAPP_ASSIGN_OR_RETURN(const std::string text, ReadInput(file));
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameLog> logs, ParseFrameLogs(file, text));
    content.logs.insert(content.logs.end(), logs.begin(), logs.end());
  }
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(content.map, client.ExportMap(options.map_name, options.at));
  MAPP_ASSIGN_OR_RETURN(content.sessions, client.ListSessions(options.map_name));
  MAPP_ASSIGN_OR_RETURN(const std::string png, DrawMap(content, options.image));
  MAPP_RETURN_IF_ERROR(WriteOutput(options.out_file, png, out));
  if (options.out_file == "-") return absl::OkStatus();
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("map", content.map.map.name).Field("file", options.out_file);
    json.Field("num_frames", content.map.frames.size()).Field("num_points", content.map.points.size()).EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("{}: {} frames, {} points of map {}\n", options.out_file, content.map.frames.size(),
                       content.map.points.size(), content.map.map.name);
  }
  return absl::OkStatus();
}

}  // namespace mapp
