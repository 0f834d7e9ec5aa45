#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct VerifyCommandOptions {
  std::string server;    ///< whose database it is; not asked with `database`
  std::string database;  ///< file to look through from here; empty: ask the server
  bool json = false;
};
/// `mapp verify`. Prints every violation; DATA_LOSS with their number when there is any. CANCELLED on a stop request.
Status RunVerify(const VerifyCommandOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
