#pragma once

#include "mapp/base/status.h"

#include <istream>
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

struct SessionsShowOptions {
  std::string server;
  uint32_t id = 0;
  bool json = false;
};
/// `mapp sessions show`. NOT_FOUND: no such session.
Status RunSessionsShow(const SessionsShowOptions& options, std::ostream& out);

struct SessionsRevertOptions {
  std::string server;
  uint32_t id = 0;
  std::string reason;
  bool dry_run = false;
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp sessions revert`: takes a session's contribution out of its map; release brings it back. Errors as
/// RunSessionsRelease, but FAILED_PRECONDITION: it is quarantined, and nothing of it is in the map.
Status RunSessionsRevert(const SessionsRevertOptions& options, std::istream& in, std::ostream& out);

struct SessionsEraseOptions {
  std::string server;
  uint32_t id = 0;
  bool force = false;  ///< also when it is open
  bool dry_run = false;
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp sessions erase`: forgets a session for good. Errors as RunSessionsRelease, but FAILED_PRECONDITION: it is
/// open.
Status RunSessionsErase(const SessionsEraseOptions& options, std::istream& in, std::ostream& out);

struct SessionsReleaseOptions {
  std::string server;
  uint32_t id = 0;
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer on `in`
  bool json = false;
};
/// `mapp sessions release`: lifts a quarantine. NOT_FOUND: no such session. FAILED_PRECONDITION: it is not quarantined,
/// or nobody can be asked and `yes` is not set. CANCELLED when the answer is not yes.
Status RunSessionsRelease(const SessionsReleaseOptions& options, std::istream& in, std::ostream& out);

}  // namespace mapp
