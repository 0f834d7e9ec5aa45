#pragma once

#include "mapp/base/status.h"
#include "server/rpc/admin_service_handler.h"
#include "server/rpc/call_recorder.h"
#include "server/rpc/call_runner.h"

#include <chrono>
#include <memory>
#include <string>

namespace mapp {

class MapService;

struct RpcServerOptions {
  /// HOST:PORT; port 0 takes a free one (RpcServer::port() tells which).
  std::string listen_address = "127.0.0.1:7878";
  uint32_t max_keyframe_bytes = 64U << 10;
  /// Greatest message accepted: eight keyframes (ReportUpdate) and a margin. Larger ones get RESOURCE_EXHAUSTED.
  int max_message_bytes = 1 << 20;
  CallRunnerOptions calls;
  ServerFacts facts;
  BackUpFunction back_up;  ///< empty: the server writes none
  VerifyFunction verify;   ///< empty: it cannot be asked to
  /// Takes bundles while they arrive: one has about the size of its map.
  std::string spool_folder = "/tmp";
  CallObserver* observer = nullptr;  ///< may be null; else must outlive the server
};

/// MapService and AdminService on a socket, with gRPC's health and reflection services. Thread-safe.
class RpcServer {
 public:
  /// Serves from when it returns. UNAVAILABLE naming the address when it cannot be listened on (port in use).
  /// `service` must outlive the server.
  static StatusOr<std::unique_ptr<RpcServer>> Start(MapService& service, const RpcServerOptions& options);
  /// Shutdown() without a drain, unless it was called before.
  ~RpcServer();

  int port() const;
  /// Health says NOT_SERVING, watchers are ended, new calls are refused; calls under way have until `drain` has passed,
  /// then they are cancelled. Returns when none is left. Idempotent.
  void Shutdown(std::chrono::milliseconds drain);

 private:
  struct Impl;
  explicit RpcServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
