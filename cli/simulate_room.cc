#include "cli/simulate_room.h"

#include "sim/room.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {

Status RunSimulateRoom(const SimulateRoomOptions& options, std::ostream& out) {
  sim::RoomOptions room;
  room.seed = options.room.seed;
  room.session = static_cast<int>(options.room.session);
  MAPP_RETURN_IF_ERROR(sim::WriteRoomSequence(options.folder, room));
  const size_t num_frames = sim::RoomTrajectory(room.session).size();
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
