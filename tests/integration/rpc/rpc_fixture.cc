#include "tests/integration/rpc/rpc_fixture.h"

#include "api/convert/convert.h"
#include "mapp/codec/keyframe_codec.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>
#include <grpcpp/create_channel.h>

namespace mapp {
namespace {

constexpr std::chrono::milliseconds kNoDrain{0};

}  // namespace

void SetDeadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
}

RpcTest::RpcTest() {
  options_.listen_address = "127.0.0.1:0";
  StartServer();
}

RpcTest::~RpcTest() { StopServer(); }

void RpcTest::StartServer() {
  store_ = OpenSqliteMapStore(folder_.File("maps.db")).value();
  service_ = MapService::Create(*store_, {}).value();
  server_ = RpcServer::Start(*service_, options_).value();
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetMaxReceiveMessageSize(-1);
  channel_ = grpc::CreateCustomChannel(address(), grpc::InsecureChannelCredentials(), arguments);
  map_stub_ = v1::MapService::NewStub(channel_);
  admin_stub_ = v1::AdminService::NewStub(channel_);
}

void RpcTest::StopServer() {
  if (server_ == nullptr) return;
  server_->Shutdown(kNoDrain);
  service_->Shutdown();
  EXPECT_TRUE(store_->Close().ok());
  server_ = nullptr;
  service_ = nullptr;
  store_ = nullptr;
}

void RpcTest::RestartServer() {
  options_.listen_address = address();
  StopServer();
  StartServer();
}

std::string RpcTest::address() const { return fmt::format("127.0.0.1:{}", server_->port()); }

v1::OpenSessionRequest RpcTest::OpenRequest(const std::string& map_name) {
  v1::OpenSessionRequest request;
  request.set_map_name(map_name);
  request.set_device("tester");
  request.set_sensor(v1::SENSOR_KIND_RGBD);
  *request.mutable_camera() = ToProto(testing::SyntheticWorld::DeviceCamera());
  request.set_create_map(true);
  return request;
}

SessionId RpcTest::Open(const std::string& map_name) {
  grpc::ClientContext context;
  SetDeadline(context);
  v1::OpenSessionResponse response;
  const grpc::Status status = map_stub_->OpenSession(&context, OpenRequest(map_name), &response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return SessionId(response.session_id());
}

grpc::Status RpcTest::Upload(const Keyframe& keyframe, v1::UploadPartialKeyframeResponse& response) {
  grpc::ClientContext context;
  SetDeadline(context);
  v1::UploadPartialKeyframeRequest request;
  request.set_keyframe(EncodeKeyframe(keyframe));
  return map_stub_->UploadPartialKeyframe(&context, request, &response);
}

Keyframe RpcTest::View(const Pose3& T_world_camera, const Pose3& T_world_session, SessionId session, uint32_t number) {
  Keyframe keyframe = world_.View(T_world_camera, session, number, rng_);
  keyframe.pose_frame = PoseFrame::kSession;
  keyframe.T_frame_camera = T_world_session.Inverse() * T_world_camera;
  keyframe.stamp_ns = int64_t{number} * 1'000'000'000;
  return keyframe;
}

v1::MapInfo RpcTest::GetMap(const std::string& name) {
  grpc::ClientContext context;
  SetDeadline(context);
  v1::GetMapRequest request;
  request.set_name(name);
  v1::GetMapResponse response;
  const grpc::Status status = admin_stub_->GetMap(&context, request, &response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return response.map();
}

}  // namespace mapp
