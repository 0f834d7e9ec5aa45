#pragma once

#include "mapp/base/status.h"

#include <cstdint>
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
  bool json = false;
};
/// `mapp maps tag`. INVALID_ARGUMENT: the tag is a number; else as RunMapsDiff.
Status RunMapsTag(const MapsTagOptions& options, std::ostream& out);

}  // namespace mapp
