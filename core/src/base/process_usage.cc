#include "mapp/base/process_usage.h"

#include <fmt/format.h>

#include <fstream>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

namespace mapp {
namespace {

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

Status NoSuchProcess(int pid) { return absl::NotFoundError(fmt::format("there is no process {}", pid)); }

/// Fields 14 and 15 of /proc/PID/stat, counted after the name in brackets, which may hold anything.
StatusOr<double> ReadCpuSeconds(int pid) {
  std::ifstream file(fmt::format("/proc/{}/stat", pid));
  std::string line;
  if (!std::getline(file, line)) return NoSuchProcess(pid);
  std::istringstream fields(line.substr(line.rfind(')') + 1));
  std::string skipped;
  for (int field = 3; field < 14; ++field) fields >> skipped;
  double user_ticks = 0;
  double system_ticks = 0;
  if (!(fields >> user_ticks >> system_ticks)) {
    return absl::DataLossError(fmt::format("/proc/{}/stat: no times in \"{}\"", pid, line));
  }
  return (user_ticks + system_ticks) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

}  // namespace

ProcessUsage GetProcessUsage() {
  ProcessUsage usage;
  // Where /proc does not tell, memory stays 0. Peak: not rusage's, which begins at what the parent held when it started
  // this process.
  if (const StatusOr<ProcessUsage> read = ReadProcessUsage(getpid()); read.ok()) usage = *read;
  rusage self{};
  if (getrusage(RUSAGE_SELF, &self) == 0) usage.cpu_s = Seconds(self.ru_utime) + Seconds(self.ru_stime);
  return usage;
}

StatusOr<ProcessUsage> ReadProcessUsage(int pid) {
  ProcessUsage usage;
  MAPP_ASSIGN_OR_RETURN(usage.cpu_s, ReadCpuSeconds(pid));
  std::ifstream file(fmt::format("/proc/{}/status", pid));
  if (!file) return NoSuchProcess(pid);
  for (std::string line; std::getline(file, line);) {  // "VmRSS:     1234 kB"; absent once it has ended
    std::istringstream fields(line);
    std::string name;
    uint64_t kilobytes = 0;
    fields >> name >> kilobytes;
    if (name == "VmRSS:") usage.rss_bytes = kilobytes * 1024;
    if (name == "VmHWM:") usage.peak_rss_bytes = kilobytes * 1024;
  }
  return usage;
}

double ThreadCpuSeconds() {
  timespec time{};
  if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace mapp
