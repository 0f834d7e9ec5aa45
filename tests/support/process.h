#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

class ChildProcess;

/// A folder of the test's own under the system's temporary folder, removed with everything in it.
class TempFolder {
 public:
  TempFolder();
  ~TempFolder();
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::string File(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

/// A child process (eval/process) whose output goes to files of the test's. One thread only.
class Process {
 public:
  /// Starts `command[0]` with its arguments. Standard output and error go to files in `folder`. Aborts the test program
  /// when no process can be made.
  Process(const std::vector<std::string>& command, const std::filesystem::path& folder);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// The exit code, or 128 + the signal that ended it; nullopt when it has not ended within `timeout`.
  std::optional<int> Wait(std::chrono::milliseconds timeout);
  /// Sends the signal unless the process has ended.
  void Signal(int signal);

  /// What the process has written so far.
  std::string StandardOutput() const;
  std::string StandardError() const;

 private:
  std::unique_ptr<ChildProcess> child_;
  std::filesystem::path output_file_;
  std::filesystem::path error_file_;
};

struct Finished {
  int exit_code = -1;
  std::string out;
  std::string err;
};

/// Runs a command to its end; fails the present test, and kills it, when it takes longer than `timeout`.
Finished RunCommand(const std::vector<std::string>& command, std::chrono::milliseconds timeout);

std::string ReadFile(const std::filesystem::path& file);
void WriteFile(const std::filesystem::path& file, const std::string& content);

}  // namespace mapp
