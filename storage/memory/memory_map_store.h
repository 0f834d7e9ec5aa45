#pragma once

#include "mapp/base/status.h"
#include "storage/map_store.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>

namespace mapp {

/// What stays when a store is closed: to a store in memory what the file is to one on disk. Thread-safe.
class MemoryDatabase;
std::shared_ptr<MemoryDatabase> CreateMemoryDatabase();

struct MemoryOptions {
  /// Unix time in nanoseconds for what the store dates itself.
  std::function<int64_t()> unix_now_ns = [] {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
  };
};

/// For tests: keeps everything that was ever written, and nothing beyond the process. Changes run one at a time on the
/// threads that ask for them. FAILED_PRECONDITION while another store has the database open.
StatusOr<std::unique_ptr<MapStore>> OpenMemoryMapStore(std::shared_ptr<MemoryDatabase> database,
                                                       const MemoryOptions& options = {});

}  // namespace mapp
