#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <string>

namespace mapp {

struct ServerInfoOptions {
  std::string server;
  bool json = false;
};
/// `mapp server-info`: version, schema and the time each method takes inside the server.
Status RunServerInfo(const ServerInfoOptions& options, std::ostream& out);

}  // namespace mapp
