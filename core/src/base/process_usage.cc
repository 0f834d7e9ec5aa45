#include "mapp/base/process_usage.h"

#include <fstream>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

namespace mapp {
namespace {

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

}  // namespace

ProcessUsage GetProcessUsage() {
  ProcessUsage usage;
  rusage self{};
  if (getrusage(RUSAGE_SELF, &self) == 0) {
    usage.cpu_s = Seconds(self.ru_utime) + Seconds(self.ru_stime);
    usage.peak_rss_bytes = static_cast<uint64_t>(self.ru_maxrss) * 1024;
  }
  // Sizes in pages: the whole address space, then what is resident.
  uint64_t num_pages = 0, num_resident = 0;
  if (std::ifstream("/proc/self/statm") >> num_pages >> num_resident) {
    usage.rss_bytes = num_resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  }
  return usage;
}

double ThreadCpuSeconds() {
  timespec time{};
  if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace mapp
