#pragma once

#include "mapp/base/status.h"

#include <istream>
#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct MapsListOptions {
  std::string server;
  bool json = false;
};
/// `mapp maps list`
Status RunMapsList(const MapsListOptions& options, std::ostream& out);

struct MapsShowOptions {
  std::string server;
  std::string name;
  std::string at;  ///< revision or tag; empty: now
  bool json = false;
};
/// `mapp maps show`. NOT_FOUND: no such map.
Status RunMapsShow(const MapsShowOptions& options, std::ostream& out);

struct MapsDeleteOptions {
  std::string server;
  std::string name;
  bool yes = false;          ///< do not ask
  bool force = false;        ///< also when sessions are open
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp maps delete`. Asks on `in` first; FAILED_PRECONDITION when nobody can answer and `yes` is not set; CANCELLED
/// when the answer is not yes.
Status RunMapsDelete(const MapsDeleteOptions& options, std::istream& in, std::ostream& out);

struct MapsOptimizeOptions {
  std::string server;
  std::string name;
  bool json = false;
};
/// `mapp maps optimize`. CANCELLED on a stop request, NOT_FOUND: no such map.
Status RunMapsOptimize(const MapsOptimizeOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
