#pragma once

#include "mapp/base/status.h"

#include <chrono>
#include <optional>
#include <string>

namespace mapp {

/// Effective options of mapp-server: flags, else the config file, else the environment (MAPP_*), else these defaults.
struct ServerConfig {
  std::string database_file;
  std::string listen_address = "127.0.0.1:7878";
  /// Serve addresses beyond loopback although there is no TLS: anybody who reaches the port may read and write maps.
  bool insecure_listen_any = false;
  std::string port_file;  ///< empty: none
  int cache_mb = 256;
  std::string log_level = "info";
  std::string metrics_address;  ///< empty: none
  std::string backup_folder;    ///< where callers may have backups written; empty: nowhere
  std::chrono::seconds drain{10};
};

/// What to do after parsing: run, or leave with an exit code (help and version: 0; wrong usage: 2).
struct ParsedConfig {
  ServerConfig config;
  std::optional<int> exit_code;
};

/// Prints help, version or the reason of a refusal itself.
ParsedConfig ParseServerConfig(int argc, const char* const* argv, const std::string& version);

/// Whether HOST of HOST:PORT is this machine's loopback: 127.0.0.0/8, [::1], localhost.
bool IsLoopback(const std::string& address);

}  // namespace mapp
