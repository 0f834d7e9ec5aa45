#pragma once

#include "mapp/base/status.h"

#include <cstdint>

namespace mapp {

/// What a process has used so far, all threads together.
struct ProcessUsage {
  double cpu_s = 0;             ///< user and system time
  uint64_t rss_bytes = 0;       ///< resident now; 0 where the system does not tell
  uint64_t peak_rss_bytes = 0;  ///< the most that was ever resident
};
/// Of this process.
ProcessUsage GetProcessUsage();
/// Of a running process, by its id. NOT_FOUND: there is none; CPU time in steps of 10 ms.
StatusOr<ProcessUsage> ReadProcessUsage(int pid);

/// CPU time of the calling thread so far, seconds.
double ThreadCpuSeconds();

}  // namespace mapp
