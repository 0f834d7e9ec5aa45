#pragma once

#include <cstdint>

namespace mapp {

/// What this process has used so far, all threads together.
struct ProcessUsage {
  double cpu_s = 0;             ///< user and system time
  uint64_t rss_bytes = 0;       ///< resident now; 0 where the system does not tell
  uint64_t peak_rss_bytes = 0;  ///< the most that was ever resident
};
ProcessUsage GetProcessUsage();

/// CPU time of the calling thread so far, seconds.
double ThreadCpuSeconds();

}  // namespace mapp
