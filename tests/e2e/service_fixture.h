#pragma once

#include "tests/support/process.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// Paths of the real programs, as built.
std::string MappBinary();
std::string MappServerBinary();
/// Runs `mapp` to its end.
Finished RunMapp(const std::vector<std::string>& arguments);
/// Runs `mapp` and expects exit code 1 and exactly one line on stderr that begins with "mapp: "; returns that line.
std::string ExpectFailure(const std::vector<std::string>& arguments);

/// Folder `name` of the recorded data; nullopt when it is not there.
std::optional<std::string> DataFolder(const std::string& name);

/// The number behind `"key": ` in JSON as `mapp` writes it; nullopt for null and for a key that is not there.
std::optional<double> JsonNumber(const std::string& json, const std::string& key);

/// A real `mapp-server` on a port of its own.
class ServerProcess {
 public:
  /// `port` 0 takes any free one; `more` arguments are appended. Serves `database` from the start, or fails the present
  /// test.
  ServerProcess(const std::string& database, const TempFolder& folder, int port = 0,
                const std::vector<std::string>& more = {});

  /// host:port
  std::string address() const;
  int port() const { return port_; }
  void Kill();  ///< SIGKILL, and waits for the end
  /// SIGTERM; the exit code.
  std::optional<int> Stop();
  bool IsRunning() { return !process_->Wait(std::chrono::milliseconds(0)).has_value(); }

 private:
  std::unique_ptr<Process> process_;
  int port_ = 0;
};

/// What a replay left behind.
struct Replayed {
  int exit_code = -1;
  std::string err;
  std::string json;
  std::string trajectory_file;
  std::string truth_file;

  /// 0 when the report has no such number.
  double Number(const std::string& key) const { return JsonNumber(json, key).value_or(0); }
};

/// A server on a fresh database in a temporary folder, and replays against it.
class ServiceTest : public testing::Test {
 protected:
  /// `more` arguments are appended, also when it is started again.
  void StartServer(const std::vector<std::string>& more = {});
  /// A new server on the same database and the same port, the one before having ended.
  void RestartServer();
  void KillAndRestartServer();
  ServerProcess& server() { return *server_; }
  const TempFolder& folder() const { return folder_; }
  std::string database() const { return folder_.File("map.db"); }

  /// Arguments of a replay whose files are named after `device`; `more` is appended.
  std::vector<std::string> ReplayArguments(const std::string& sequence, const std::string& device,
                                           const std::vector<std::string>& more = {}) const;
  /// Runs it to its end.
  Replayed Replay(const std::string& sequence, const std::string& device, const std::vector<std::string>& more = {});
  /// What a replay of `device` that ended has left.
  Replayed CollectReplay(const std::string& device, int exit_code, const std::string& err) const;
  /// `--align-by` of the first session's replay.
  static std::vector<std::string> AlignBy(const Replayed& first);

 private:
  TempFolder folder_;
  std::vector<std::string> server_arguments_;
  std::unique_ptr<ServerProcess> server_;
};

}  // namespace mapp
