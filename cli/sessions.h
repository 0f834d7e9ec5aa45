#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <string>

namespace mapp {

struct SessionsListOptions {
  std::string server;
  std::string map_name;  ///< empty: of all maps
  bool json = false;
};
/// `mapp sessions list`. NOT_FOUND: no such map.
Status RunSessionsList(const SessionsListOptions& options, std::ostream& out);

}  // namespace mapp
