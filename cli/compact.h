#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <istream>
#include <optional>
#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct CompactOptions {
  std::string server;
  std::string map_name;  ///< empty: all maps
  std::optional<uint64_t> keep_revisions;
  std::optional<double> keep_days;
  bool rewrite = false;  ///< the whole file afterwards
  bool dry_run = false;
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp compact`. Says what would go and asks on `in` first. INVALID_ARGUMENT: nothing said of what to keep;
/// NOT_FOUND: no such map; CANCELLED: the answer is not yes, or a stop request: then what was dropped by then stays
/// dropped.
Status RunCompact(const CompactOptions& options, const std::stop_token& stop, std::istream& in, std::ostream& out);

}  // namespace mapp
