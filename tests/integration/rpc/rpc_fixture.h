#pragma once

#include "mapp/v1/admin_service.grpc.pb.h"
#include "mapp/v1/map_service.grpc.pb.h"
#include "server/rpc/rpc_server.h"
#include "server/service/map_service.h"
#include "storage/map_store.h"
#include "tests/support/process.h"
#include "tests/support/synthetic_world.h"

#include <grpcpp/channel.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace mapp {

/// The real server in this process: SQLite in a temporary folder, MapService, gRPC on a free loopback port.
class RpcTest : public ::testing::Test {
 protected:
  RpcTest();
  ~RpcTest() override;

  void StartServer();
  /// In the order that mapp-server stops in.
  void StopServer();
  /// Stops the server and starts it again on the same port with the same database.
  void RestartServer();

  std::string address() const;
  v1::MapService::Stub& map_service() { return *map_stub_; }
  v1::AdminService::Stub& admin_service() { return *admin_stub_; }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }

  static v1::OpenSessionRequest OpenRequest(const std::string& map_name = "room");
  /// A new session of the map, through the wire.
  SessionId Open(const std::string& map_name = "room");
  grpc::Status Upload(const Keyframe& keyframe, v1::UploadPartialKeyframeResponse& response);
  /// What the world shows at `T_world_camera`, with the pose in a session frame that begins at `T_world_session`.
  Keyframe View(const Pose3& T_world_camera, const Pose3& T_world_session, SessionId session, uint32_t number);
  v1::MapInfo GetMap(const std::string& name = "room");

  TempFolder folder_;
  testing::SyntheticWorld world_{1};
  Rng rng_{2};
  RpcServerOptions options_;
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<MapService> service_;
  std::unique_ptr<RpcServer> server_;

 private:
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::MapService::Stub> map_stub_;
  std::unique_ptr<v1::AdminService::Stub> admin_stub_;
};

/// For calls that should not take long; a test that hangs fails on it.
void SetDeadline(grpc::ClientContext& context);

}  // namespace mapp
