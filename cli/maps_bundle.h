#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct MapsExportOptions {
  std::string server;
  std::string name;
  std::string at;      ///< revision or tag; empty: now
  std::string bundle;  ///< file to write
  bool force = false;  ///< replace one that is there
  bool json = false;
};
/// `mapp maps export`. The file is there whole or not at all. ALREADY_EXISTS: it is there and `force` is false;
/// CANCELLED on a stop request.
Status RunMapsExport(const MapsExportOptions& options, const std::stop_token& stop, std::ostream& out);

struct MapsImportOptions {
  std::string server;
  std::string bundle;  ///< file to read
  std::string as;      ///< name of the new map; empty: the bundle's
  bool dry_run = false;
  bool json = false;
};
/// `mapp maps import`. Checks all of the bundle before it asks the server, which it does not with `dry_run`. Errors
/// name the file or the map; nothing has been imported then. CANCELLED on a stop request.
Status RunMapsImport(const MapsImportOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
