#include "server/rpc/rpc_server.h"

#include "server/rpc/map_service_handler.h"
#include "server/rpc/watchers.h"

#include <fmt/format.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

namespace mapp {
namespace {

/// Each synchronous call under way holds a thread; beyond this, calls get RESOURCE_EXHAUSTED.
constexpr int kMaxThreads = 512;
/// How often a client may ping an idle connection to find out whether the server is still there.
constexpr int kMinPingIntervalMs = 10'000;
constexpr const char* kServiceNames[] = {"mapp.v1.MapService", "mapp.v1.AdminService"};

void SetServing(grpc::Server& server, bool serving) {
  grpc::HealthCheckServiceInterface* health = server.GetHealthCheckService();
  for (const char* name : kServiceNames) health->SetServingStatus(name, serving);
  health->SetServingStatus(serving);
}

}  // namespace

struct RpcServer::Impl {
  Impl(MapService& service, const RpcServerOptions& options)
      : recorder(options.observer),
        runner(options.calls, recorder),
        map_handler(service, runner, watchers, options.max_keyframe_bytes),
        admin_handler(service, runner, options.facts, options.back_up, options.verify, options.spool_folder) {}

  CallRecorder recorder;
  CallRunner runner;
  Watchers watchers;
  MapServiceHandler map_handler;
  AdminServiceHandler admin_handler;
  std::unique_ptr<grpc::Server> server;
  int port = 0;
  Mutex shutdown_mutex;
  bool is_shut_down ABSL_GUARDED_BY(shutdown_mutex) = false;
};

StatusOr<std::unique_ptr<RpcServer>> RpcServer::Start(MapService& service, const RpcServerOptions& options) {
  auto impl = std::make_unique<Impl>(service, options);
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  builder.AddListeningPort(options.listen_address, grpc::InsecureServerCredentials(), &impl->port);
  // Two servers on one port would share its calls at random; better that the second fails.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinPingIntervalMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.SetMaxReceiveMessageSize(options.max_message_bytes);
  grpc::ResourceQuota quota("mapp-server");
  quota.SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
  builder.RegisterService(&impl->map_handler);
  builder.RegisterService(&impl->admin_handler);
  impl->server = builder.BuildAndStart();
  if (impl->server == nullptr || impl->port == 0) {
    return absl::UnavailableError(fmt::format(
        "cannot listen on {}: the port is in use or the address is not this machine's", options.listen_address));
  }
  SetServing(*impl->server, true);
  return std::unique_ptr<RpcServer>(new RpcServer(std::move(impl)));
}

RpcServer::RpcServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

RpcServer::~RpcServer() { Shutdown(std::chrono::milliseconds(0)); }

int RpcServer::port() const { return impl_->port; }

void RpcServer::Shutdown(std::chrono::milliseconds drain) {
  MutexLock lock(impl_->shutdown_mutex);  // held throughout: a second caller returns when the first is done
  if (impl_->is_shut_down) return;
  impl_->is_shut_down = true;
  SetServing(*impl_->server, false);
  impl_->watchers.EndAll();
  impl_->server->Shutdown(std::chrono::system_clock::now() + drain);
  impl_->server->Wait();
}

}  // namespace mapp
