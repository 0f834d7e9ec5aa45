#pragma once

#include "mapp/base/status.h"

#include <chrono>
#include <istream>
#include <ostream>
#include <stop_token>
#include <string>

namespace mapp {

struct BackupCommandOptions {
  std::string server;    ///< that writes the backup; not asked with `database`
  std::string database;  ///< file to back up from here; empty: ask the server
  std::string to;        ///< BackupOptions::to; the server's machine's, when it writes
  int num_kept = 0;      ///< 0 = all
  bool dry_run = false;
  bool json = false;
};
/// `mapp backup`; with `dry_run` it only says what would be written and deleted. CANCELLED on a stop request; nothing
/// is left then.
Status RunBackup(const BackupCommandOptions& options, const std::stop_token& stop, std::ostream& out);

struct RestoreCommandOptions {
  std::string backup;
  std::string database;
  bool yes = false;          ///< do not ask
  bool interactive = false;  ///< a person can answer on `in`
  bool dry_run = false;
  bool json = false;
  std::chrono::system_clock::time_point now = std::chrono::system_clock::now();
};
/// `mapp restore`. Asks on `in` before it replaces a database; FAILED_PRECONDITION when nobody can answer and `yes` is
/// not set; CANCELLED when the answer is not yes, or on a stop request: nothing is changed then.
Status RunRestore(const RestoreCommandOptions& options, const std::stop_token& stop, std::istream& in,
                  std::ostream& out);

}  // namespace mapp
