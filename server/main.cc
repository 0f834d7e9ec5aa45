// mapp-server: the map service as a process.

#include "log/log.h"
#include "server/backup_folder.h"
#include "server/config.h"
#include "server/grpc_log.h"
#include "server/rpc/prometheus_exporter.h"
#include "server/rpc/rpc_server.h"
#include "server/service/loop.h"
#include "server/service/map_service.h"
#include "storage/sqlite/migrator.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "storage/verify.h"
#include "vision/place_block.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <malloc.h>
#include <pthread.h>
#include <signal.h>

namespace mapp {
namespace {

constexpr int kExitFailed = 1;

/// SIGTERM and SIGINT as something to wait for. Constructed before the first thread, which all inherit the block.
class StopSignals {
 public:
  StopSignals() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGTERM);
    sigaddset(&signals_, SIGINT);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    signal(SIGPIPE, SIG_IGN);  // a log reader that went away is no reason to stop serving
  }
  /// Returns the signal's name. A second one ends the process at once, which loses nothing that was acknowledged.
  std::string Wait() {
    int signal = 0;
    sigwait(&signals_, &signal);
    pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
    return signal == SIGTERM ? "SIGTERM" : "SIGINT";
  }

 private:
  sigset_t signals_;
};

void LogConfig(const ServerConfig& config) {
  log::Info("starting", {{"version", MAPP_VERSION},
                         {"db", config.database_file},
                         {"listen", config.listen_address},
                         {"insecure_listen_any", config.insecure_listen_any},
                         {"port_file", config.port_file},
                         {"cache_mb", config.cache_mb},
                         {"log_level", config.log_level},
                         {"metrics_listen", config.metrics_address},
                         {"backup_dir", config.backup_folder},
                         {"drain_seconds", config.drain.count()}});
}

/// Of a run before this one: a script that waits for the file must not find it.
Status RemovePortFile(const std::string& file) {
  std::error_code error;
  std::filesystem::remove(file, error);
  if (error) return absl::InternalError(fmt::format("cannot remove the old port file {}: {}", file, error.message()));
  return absl::OkStatus();
}

/// Beside and renamed, so that a script that waits for the file never reads half of it.
Status WritePortFile(const std::string& file, int port) {
  const std::string partial = file + ".partial";
  {
    std::ofstream out(partial, std::ios::trunc);
    out << port << '\n';
    out.close();
    if (!out) return absl::InternalError(fmt::format("cannot write the port file {}", partial));
  }
  std::error_code error;
  std::filesystem::rename(partial, file, error);
  if (error) return absl::InternalError(fmt::format("cannot write the port file {}: {}", file, error.message()));
  return absl::OkStatus();
}

/// `exporter` may be null.
MapServiceOptions ServiceOptions(const ServerConfig& config, PrometheusExporter* exporter) {
  MapServiceOptions options;
  options.guard.on_quarantined = [exporter](const QuarantinedSession& quarantined) {
    const std::string finding = FindingName(quarantined.ruling.finding);
    log::Warning("session_quarantined", {{"session", quarantined.session.value()},
                                         {"device", quarantined.device},
                                         {"finding", finding},
                                         {"frames_retired", quarantined.retired_frames.size()},
                                         {"points_retired", quarantined.num_retired_points},
                                         {"reason", quarantined.ruling.reason}});
    if (exporter != nullptr) exporter->OnSessionQuarantined(finding);
  };
  options.cache_bytes = static_cast<size_t>(config.cache_mb) << 20;
  options.registrar.on_error = [](SessionId session, const Status& status) {
    log::Warning("registration_failed", {{"session", session.value()}, {"error", status.ToString()}});
  };
  options.registrar.on_loop_closed = [exporter](SessionId session, const ClosedLoop& closed) {
    log::Info("loop_closed", {{"session", session.value()},
                              {"frames", closed.num_frames},
                              {"max_motion_m", closed.max_motion_m},
                              {"points_fused", closed.num_fused}});
    if (exporter != nullptr) exporter->OnLoopClosed();
  };
  options.optimizer.on_error = [](SessionId session, const Status& status) {
    log::Warning("optimization_failed", {{"session", session.value()}, {"error", status.ToString()}});
  };
  return options;
}

RpcServerOptions RpcOptions(const ServerConfig& config, const MapServiceOptions& service, CallObserver* observer) {
  RpcServerOptions options;
  options.listen_address = config.listen_address;
  options.max_keyframe_bytes = static_cast<uint32_t>(service.max_keyframe_bytes);
  options.facts.version = MAPP_VERSION;
  options.facts.schema_version = static_cast<uint32_t>(sqlite::EmbeddedMigrations().back().version);
  options.facts.started_unix_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  options.observer = observer;
  if (!config.backup_folder.empty()) {
    const BackupFolder folder(config.database_file, config.backup_folder);
    options.back_up = [folder](const CallContext& context, const BackupOptions& backup) {
      return folder.BackUp(context, backup);
    };
  }
  const std::filesystem::path database(config.database_file);
  options.spool_folder = database.has_parent_path() ? database.parent_path().string() : ".";
  options.verify = [file = config.database_file](const CallContext& context,
                                                 const std::function<void(const VerifyProgress&)>& on_progress) {
    VerifyOptions verify;
    verify.check_place_block = [](std::string_view block) { return DecodePlaceBlock(block).status(); };
    verify.on_progress = on_progress;
    return VerifyDatabase(context, file, verify);
  };
  return options;
}

/// Memory that tiles leave goes to those that come: with an arena for each of gRPC's threads, as is the default, what
/// one has freed is no use to the others, and the process holds twice what it uses. bench/scale_bench.
void ShareFreedMemory() { mallopt(M_ARENA_MAX, 1); }

/// Serves until a stop signal; everything is in order again when it returns.
Status Serve(const ServerConfig& config, StopSignals& signals) {
  if (!config.port_file.empty()) MAPP_RETURN_IF_ERROR(RemovePortFile(config.port_file));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> store, OpenSqliteMapStore(config.database_file));
  std::unique_ptr<PrometheusExporter> exporter;  // outlives the service, whose threads report to it
  if (!config.metrics_address.empty()) {
    MAPP_ASSIGN_OR_RETURN(exporter, PrometheusExporter::Listen(config.metrics_address));
  }
  const MapServiceOptions service_options = ServiceOptions(config, exporter.get());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapService> service, MapService::Create(*store, service_options));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<RpcServer> server,
                        RpcServer::Start(*service, RpcOptions(config, service_options, exporter.get())));
  if (!config.port_file.empty()) MAPP_RETURN_IF_ERROR(WritePortFile(config.port_file, server->port()));
  log::Info("serving", {{"port", server->port()}});

  const std::string signal = signals.Wait();
  log::Info("draining", {{"signal", signal}, {"seconds", config.drain.count()}});
  server->Shutdown(config.drain);
  service->Shutdown();
  MAPP_RETURN_IF_ERROR(store->Close());
  log::Info("stopped");
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  ShareFreedMemory();
  StopSignals signals;
  const ParsedConfig parsed = ParseServerConfig(argc, argv, MAPP_VERSION);
  if (parsed.exit_code) return *parsed.exit_code;
  log::SetLevel(parsed.config.log_level);
  RouteGrpcLog();
  LogConfig(parsed.config);
  const Status status = Serve(parsed.config, signals);
  if (status.ok()) return 0;
  const std::string message(status.message().data(), status.message().size());
  std::fprintf(stderr, "mapp-server: %s\n", message.c_str());
  return kExitFailed;
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) { return mapp::Main(argc, argv); }
