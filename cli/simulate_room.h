#pragma once

#include "cli/sequence_source.h"
#include "mapp/base/status.h"

#include <ostream>
#include <string>

namespace mapp {

struct SimulateRoomOptions {
  std::string folder;  ///< made when absent
  RoomSpec room;
  bool json = false;
};
/// `mapp simulate-room`: writes one session of the rendered room in the TUM RGB-D layout, with its exact trajectory.
Status RunSimulateRoom(const SimulateRoomOptions& options, std::ostream& out);

}  // namespace mapp
