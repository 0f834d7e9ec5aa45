#include "server/config.h"

#include <CLI/CLI.hpp>

#include <iostream>

namespace mapp {
namespace {

constexpr int kExitWrongUsage = 2;
constexpr int kMaxPort = 65535;

/// CLI11 validator: empty string when `address` is HOST:PORT.
std::string CheckAddress(const std::string& address) {
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0) return "must be HOST:PORT, got \"" + address + "\"";
  const std::string port = address.substr(colon + 1);
  const bool is_number = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (!is_number || std::stoi(port) > kMaxPort) return "port must be 0 to 65535, got \"" + port + "\"";
  return "";
}

void AddOptions(CLI::App& app, ServerConfig& config, int& drain_seconds) {
  const CLI::Validator address(CheckAddress, "HOST:PORT");
  app.add_option("--db", config.database_file, "Map database (SQLite), created when it does not exist")
      ->envname("MAPP_DB")
      ->required();
  app.add_option("--listen", config.listen_address, "Address to serve on; port 0 takes a free one")
      ->envname("MAPP_LISTEN")
      ->check(address)
      ->capture_default_str();
  app.add_flag(
         "--insecure-listen-any", config.insecure_listen_any,
         "Allow --listen and --metrics-listen beyond loopback, although there is no TLS: whoever reaches the port "
         "may read and write all maps")
      ->envname("MAPP_INSECURE_LISTEN_ANY");
  app.add_option("--port-file", config.port_file, "Write the port to this file once serving")
      ->envname("MAPP_PORT_FILE");
  app.add_option("--cache-mb", config.cache_mb, "Memory for tiles, in MB (2^20 bytes)")
      ->envname("MAPP_CACHE_MB")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "Least severe lines to log")
      ->envname("MAPP_LOG_LEVEL")
      ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
      ->capture_default_str();
  app.add_option("--metrics-listen", config.metrics_address, "Serve Prometheus metrics at http://HOST:PORT/metrics")
      ->envname("MAPP_METRICS_LISTEN")
      ->check(address);
  app.add_option("--backup-dir", config.backup_folder,
                 "Folder that mapp backup may write into; without it the server writes no backups")
      ->envname("MAPP_BACKUP_DIR")
      ->check(CLI::ExistingDirectory)
      ->type_name("DIR");
  app.add_option("--drain-seconds", drain_seconds, "At SIGTERM or SIGINT: time for calls under way, in seconds")
      ->envname("MAPP_DRAIN_SECONDS")
      ->check(CLI::Range(0, 3600))
      ->capture_default_str();
}

/// Empty when every address is loopback or the operator has said that it need not be.
std::string CheckExposure(const ServerConfig& config) {
  if (config.insecure_listen_any) return "";
  if (!IsLoopback(config.listen_address)) {
    return "--listen: " + config.listen_address +
           " is not loopback, and there is no TLS yet; give --insecure-listen-any to serve it all the same";
  }
  if (!config.metrics_address.empty() && !IsLoopback(config.metrics_address)) {
    return "--metrics-listen: " + config.metrics_address +
           " is not loopback; give --insecure-listen-any to serve it all the same";
  }
  return "";
}

}  // namespace

bool IsLoopback(const std::string& address) {
  const std::string host = address.substr(0, address.rfind(':'));
  const bool is_numeric = host.find_first_not_of("0123456789.") == std::string::npos;  // not a name like 127.example
  return host == "localhost" || host == "[::1]" || (is_numeric && host.starts_with("127."));
}

ParsedConfig ParseServerConfig(int argc, const char* const* argv, const std::string& version) {
  ParsedConfig parsed;
  int drain_seconds = static_cast<int>(parsed.config.drain.count());
  CLI::App app("Map++ server: keeps shared visual maps in one SQLite file and serves them over gRPC.", "mapp-server");
  app.set_version_flag("--version", "mapp-server " + version);
  app.footer(
      "An option comes from its flag, else from the config file (key = value, keys as the flags without dashes), else\n"
      "from its environment variable, else from its default.\n"
      "Exit codes: 0 stopped by SIGTERM or SIGINT, 1 failed, 2 wrong usage.");
  app.set_config("--config", "", "Config file (TOML or INI)");
  app.allow_config_extras(CLI::config_extras_mode::error);
  AddOptions(app, parsed.config, drain_seconds);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    parsed.exit_code = app.exit(help_or_version);
    return parsed;
  } catch (const CLI::Error& error) {
    std::cerr << "mapp-server: " << error.what() << " (--help lists the options)\n";
    parsed.exit_code = kExitWrongUsage;
    return parsed;
  }
  if (const std::string refusal = CheckExposure(parsed.config); !refusal.empty()) {
    std::cerr << "mapp-server: " << refusal << '\n';
    parsed.exit_code = kExitWrongUsage;
  }
  parsed.config.drain = std::chrono::seconds(drain_seconds);
  return parsed;
}

}  // namespace mapp
