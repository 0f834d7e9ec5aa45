#pragma once

#include "mapp/base/process_usage.h"
#include "mapp/base/status.h"

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace mapp {

struct ChildOptions {
  /// The program's path, then its arguments.
  std::vector<std::string> command;
  /// Files that take its standard output and error; created or emptied. May be the same one.
  std::string output_file;
  std::string error_file;
  /// NAME=VALUE, besides the environment of this process; a name given here wins.
  std::vector<std::string> environment;
};

/// A child process, killed when this object goes or when the thread that started it ends. It reads nothing: its
/// standard input is empty. One thread at a time.
class ChildProcess {
 public:
  /// INVALID_ARGUMENT without a command; NOT_FOUND or PERMISSION_DENIED naming the program or file that cannot be
  /// run or written; RESOURCE_EXHAUSTED when no process can be made.
  static StatusOr<std::unique_ptr<ChildProcess>> Start(const ChildOptions& options);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  /// The exit code, or 128 + the signal that ended it; nullopt when it has not ended within `timeout`.
  std::optional<int> Wait(std::chrono::milliseconds timeout);
  /// Sends the signal unless the process has been seen to end.
  void Signal(int signal);
  /// What it has used: so far while it runs, in all once Wait has seen it end. Of one that has ended, `peak_rss_bytes`
  /// is 0 when it stayed below what this process held when it started it: Linux counts a child's memory from there.
  StatusOr<ProcessUsage> Usage() const;

 private:
  ChildProcess(pid_t pid, int pid_fd, uint64_t starter_rss_bytes)
      : pid_(pid), pid_fd_(pid_fd), starter_rss_bytes_(starter_rss_bytes) {}
  void Reap();

  pid_t pid_;
  int pid_fd_;
  uint64_t starter_rss_bytes_;  // when it was started
  std::optional<int> exit_code_;
  ProcessUsage final_usage_;
};

}  // namespace mapp
