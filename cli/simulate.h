#pragma once

#include "cli/sequence_source.h"
#include "mapp/base/status.h"
#include "sim/world/visit.h"
#include "sim/world/visit_sequence.h"

#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct SimulateOptions {
  std::string folder;  ///< made; may be there if empty
  sim::SimulationOptions simulation;
  sim::ImageOptions images;
  bool json = false;
};
/// `mapp simulate SETTING`: writes a folder a user, the true mesh and changes, and a picture
/// (docs/formats/simulation.md lists the files). On errors, and CANCELLED by `stop`, nothing is left. ALREADY_EXISTS:
/// the folder is not empty.
Status RunSimulate(const SimulateOptions& options, const std::stop_token& stop, std::ostream& out);

struct SimulateRoomOptions {
  std::string folder;
  RoomSpec room;
  bool json = false;
};
/// `mapp simulate room`: writes one session of the rendered room in the TUM RGB-D layout, with its exact trajectory.
/// Errors as above.
Status RunSimulateRoom(const SimulateRoomOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
