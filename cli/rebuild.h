#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct RebuildCommandOptions {
  std::string database;  ///< whose keyframe log is read; it is not changed
  std::string to;        ///< the new database
  int num_threads = 1;
  bool json = false;
};
/// `mapp rebuild` (RebuildDatabase). DATA_LOSS when the new database is there, but not all could be taken over.
/// CANCELLED on a stop request.
Status RunRebuild(const RebuildCommandOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
