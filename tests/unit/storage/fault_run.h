#pragma once

#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/fault_disk.h"

#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

struct FaultRunOptions {
  bool sync_commits = true;
  /// Small, so that the log is folded into the file now and then.
  int page_bytes = 1024;
  /// The power goes as soon as something is refused.
  bool ends_when_refused = false;
};

struct FaultRunResult {
  std::string struck;  ///< the operation that went wrong; empty when the run came to its end before
  int64_t num_operations = 0;
  std::vector<std::string> operations;  ///< of a run without a fault
  int num_acknowledged = 0;
  int num_refused = 0;
  /// What the store has not kept of its promises.
  std::vector<std::string> problems;
};

/// Runs the script (fault_script.h), backups and closing on a SQLite store whose disk has the fault, trying again what
/// is refused, and cuts the power at last. Every step is mirrored in memory when it is acknowledged: looks whether what
/// is read while the disk is ill, and what is left of the file, is just that, and nothing is wrong with it.
FaultRunResult RunOnFaultyDisk(const DiskFault& fault, const FaultRunOptions& options = {});

}  // namespace mapp
