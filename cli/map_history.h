#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <istream>
#include <ostream>
#include <string>

namespace mapp {

struct MapsLogOptions {
  std::string server;
  std::string name;
  uint32_t max_runs = 20;
  bool json = false;
};
/// `mapp maps log`: what the map's revisions were made for, newest first. NOT_FOUND: no such map.
Status RunMapsLog(const MapsLogOptions& options, std::ostream& out);

struct MapsDiffOptions {
  std::string server;
  std::string name;
  std::string from, to;  ///< revisions or tags; `to` empty: now
  bool json = false;
};
/// `mapp maps diff`. NOT_FOUND: no such map or tag; OUT_OF_RANGE: no such revision.
Status RunMapsDiff(const MapsDiffOptions& options, std::ostream& out);

struct MapsTagOptions {
  std::string server;
  std::string name;
  std::string tag;  ///< empty: list the tags
  std::string at;   ///< revision or tag; empty: now
  bool remove = false;
  bool yes = false;          ///< do not ask before it is removed
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp maps tag`. Asks on `in` before it removes a tag; FAILED_PRECONDITION when nobody can answer and `yes` is not
/// set; CANCELLED when the answer is not yes. INVALID_ARGUMENT: the tag is a number; else as RunMapsDiff.
Status RunMapsTag(const MapsTagOptions& options, std::istream& in, std::ostream& out);

}  // namespace mapp
