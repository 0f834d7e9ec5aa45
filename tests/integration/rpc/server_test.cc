// The server as a whole: health, reflection, its port, its figures, and how it stops.

#include "api/status/grpc_status.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <fstream>
#include <thread>

namespace mapp {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

/// One message to a method whose generated code Debian does not ship, and the first one back, both as bytes.
class RawCall {
 public:
  RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method) : stub_(channel) {
    SetDeadline(context_);
    call_ = stub_.PrepareCall(&context_, method, &queue_);
    call_->StartCall(this);
    Await();
  }
  ~RawCall() {
    context_.TryCancel();
    grpc::Status status;
    call_->Finish(&status, this);
    Await();
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  void Send(const std::string& message) {
    const grpc::Slice slice(message);
    call_->Write(grpc::ByteBuffer(&slice, 1), this);
    Await();
  }
  std::string Receive() {
    grpc::ByteBuffer buffer;
    call_->Read(&buffer, this);
    if (!Await()) return "";
    std::vector<grpc::Slice> slices;
    EXPECT_TRUE(buffer.Dump(&slices).ok());
    std::string message;
    for (const grpc::Slice& slice : slices) message.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
    return message;
  }

 private:
  bool Await() {
    void* tag = nullptr;
    bool ok = false;
    return queue_.Next(&tag, &ok) && ok;
  }

  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
};

// grpc.health.v1.HealthCheckRequest{service = 1} and HealthCheckResponse{status = 1}.
const std::string kHealthOfMapService = std::string("\x0a\x12") + "mapp.v1.MapService";
const std::string kServing = "\x08\x01";
const std::string kNotServing = "\x08\x02";

TEST_F(RpcTest, HealthSaysServingAndNotServingWhileItDrains) {
  RawCall watch(channel(), "/grpc.health.v1.Health/Watch");
  watch.Send(kHealthOfMapService);
  EXPECT_EQ(watch.Receive(), kServing);
  std::thread stopper([this] { server_->Shutdown(std::chrono::seconds(5)); });
  EXPECT_EQ(watch.Receive(), kNotServing);
  stopper.join();
}

TEST_F(RpcTest, ReflectionListsBothServices) {
  RawCall reflection(channel(), "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo");
  reflection.Send("\x3a\x01*");  // ServerReflectionRequest{list_services = 7}
  const std::string services = reflection.Receive();
  EXPECT_THAT(services, HasSubstr("mapp.v1.MapService"));
  EXPECT_THAT(services, HasSubstr("mapp.v1.AdminService"));
  EXPECT_THAT(services, HasSubstr("grpc.health.v1.Health"));
}

TEST_F(RpcTest, APortInUseIsOneClearLine) {
  RpcServerOptions options;
  options.listen_address = address();
  const auto second = RpcServer::Start(*service_, options);
  EXPECT_EQ(second.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(second.status().ToString(), HasSubstr(address()));
}

TEST_F(RpcTest, InfoCountsCallsAndErrors) {
  Open();
  grpc::ClientContext bad_context;
  SetDeadline(bad_context);
  v1::OpenSessionResponse opened;
  EXPECT_FALSE(map_service().OpenSession(&bad_context, {}, &opened).ok());
  grpc::ClientContext context;
  SetDeadline(context);
  v1::GetServerInfoResponse info;
  ASSERT_TRUE(admin_service().GetServerInfo(&context, {}, &info).ok());
  ASSERT_EQ(info.methods_size(), 1);
  EXPECT_EQ(info.methods(0).method(), "OpenSession");
  EXPECT_EQ(info.methods(0).num_calls(), 2U);
  EXPECT_EQ(info.methods(0).num_errors(), 1U);
  EXPECT_GT(info.methods(0).mean_ms(), 0);
  EXPECT_GT(info.methods(0).median_ms(), 0);
  EXPECT_GE(info.methods(0).p95_ms(), info.methods(0).median_ms());
  EXPECT_GT(info.cpu_s(), 0);
  EXPECT_GT(info.rss_bytes(), 1U << 20);
  EXPECT_GE(info.peak_rss_bytes(), info.rss_bytes() / 2);
}

/// A watcher in a state that tests can wait for.
class Watch {
 public:
  Watch(v1::MapService::Stub& stub, SessionId session) {
    SetDeadline(context_);
    v1::WatchSessionRequest request;
    request.set_session_id(static_cast<uint32_t>(session.value()));
    reader_ = stub.WatchSession(&context_, request);
  }
  ~Watch() {
    context_.TryCancel();
    v1::WatchSessionResponse rest;
    while (reader_->Read(&rest)) {
    }
    reader_->Finish();
  }
  /// EVENT_NOT_SET once the stream has ended.
  v1::WatchSessionResponse Next() {
    v1::WatchSessionResponse response;
    if (!reader_->Read(&response)) response.Clear();
    return response;
  }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::WatchSessionResponse>> reader_;
};

TEST_F(RpcTest, AWatcherHearsThatItsSessionFoundedTheMap) {
  const SessionId session = Open();
  Watch watch(map_service(), session);
  EXPECT_TRUE(watch.Next().has_started());
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse response;
  ASSERT_TRUE(Upload(View(stand, stand, session, 0), response).ok());
  EXPECT_TRUE(watch.Next().has_tiles_changed());
}

TEST_F(RpcTest, AWatcherOfAnAlignedSessionHearsItsAlignmentFirst) {
  const SessionId session = Open();
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse response;
  ASSERT_TRUE(Upload(View(stand, stand, session, 0), response).ok());
  EXPECT_TRUE(response.has_pose_map_session()) << "the first metric session founds the map";
  Watch watch(map_service(), session);
  EXPECT_TRUE(watch.Next().has_aligned());
  EXPECT_TRUE(watch.Next().has_started());
}

TEST_F(RpcTest, ManyWatchersLeaveRoomForCalls) {
  const SessionId session = Open();
  std::vector<std::unique_ptr<Watch>> watches;
  for (int i = 0; i < 600; ++i) watches.push_back(std::make_unique<Watch>(map_service(), session));
  for (const auto& watch : watches) EXPECT_TRUE(watch->Next().has_started());
  // More than the server has threads: a call still finds one.
  EXPECT_EQ(GetMap().name(), "room");
}

TEST_F(RpcTest, StoppingEndsWatchersWithoutWaitingForThem) {
  const SessionId session = Open();
  Watch watch(map_service(), session);
  EXPECT_TRUE(watch.Next().has_started());
  const auto begin = std::chrono::steady_clock::now();
  server_->Shutdown(std::chrono::minutes(5));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::minutes(1));
  EXPECT_EQ(watch.Next().event_case(), v1::WatchSessionResponse::EVENT_NOT_SET);
}

TEST_F(RpcTest, CallsWithoutADeadlineGetTheServersOwn) {
  options_.calls.default_stream_deadline = std::chrono::milliseconds(1);
  RestartServer();
  const SessionId session = Open();
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse response;
  // Views all around, so that the export is more than the connection's buffers take from a server in a hurry.
  for (uint32_t number = 0; number < 12; ++number) {
    ASSERT_TRUE(
        Upload(View(testing::SyntheticWorld::Stand(0, -2, 0.5 * number), stand, session, number), response).ok());
  }
  grpc::ClientContext context;  // no deadline
  v1::ExportMapRequest request;
  request.set_name("room");
  const auto reader = admin_service().ExportMap(&context, request);
  v1::ExportMapResponse part;
  // Reads nothing while the server's deadline passes, as a reader that stalls.
  const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(50);
  while (std::chrono::steady_clock::now() < until) std::this_thread::yield();
  while (reader->Read(&part)) {
  }
  const grpc::Status status = reader->Finish();
  EXPECT_THAT((std::vector{grpc::StatusCode::CANCELLED, grpc::StatusCode::DEADLINE_EXCEEDED}),
              ::testing::Contains(status.error_code()));
}

TEST_F(RpcTest, ExportStreamsFramesAndPoints) {
  const SessionId session = Open();
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse response;
  for (uint32_t number = 0; number < 3; ++number) {
    ASSERT_TRUE(Upload(View(stand, stand, session, number), response).ok());
  }
  grpc::ClientContext context;
  SetDeadline(context);
  v1::ExportMapRequest request;
  request.set_name("room");
  const auto reader = admin_service().ExportMap(&context, request);
  v1::ExportMapResponse part;
  v1::MapInfo map;
  uint64_t num_frames = 0;
  uint64_t num_points = 0;
  while (reader->Read(&part)) {
    if (part.has_map()) map = part.map();
    num_frames += static_cast<uint64_t>(part.frames_size());
    num_points += static_cast<uint64_t>(part.points_size());
  }
  ASSERT_TRUE(reader->Finish().ok());
  EXPECT_EQ(map.name(), "room");
  EXPECT_EQ(num_frames, 3U);
  EXPECT_EQ(num_frames, map.num_frames());
  EXPECT_GT(num_points, 0U);
  EXPECT_EQ(num_points, map.num_points());
}

TEST_F(RpcTest, AMapIsOptimizedOnCommand) {
  const SessionId session = Open();
  const Pose3 start = testing::SyntheticWorld::Stand(0, -2, 0);
  for (uint32_t i = 0; i < 4; ++i) {
    Keyframe keyframe = View(testing::SyntheticWorld::Stand(0.1 * i, -2, 0), start, session, i);
    if (i > 0) keyframe.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), {0.02, 0, 0}) * keyframe.T_frame_camera;
    v1::UploadPartialKeyframeResponse uploaded;
    ASSERT_TRUE(Upload(keyframe, uploaded).ok());
  }
  v1::OptimizeMapRequest request;
  request.set_name("room");
  v1::OptimizeMapResponse message;
  size_t num_progress = 0;
  {
    grpc::ClientContext context;
    SetDeadline(context);
    const auto reader = admin_service().OptimizeMap(&context, request);
    while (reader->Read(&message)) num_progress += message.has_progress() ? 1 : 0;
    const grpc::Status status = reader->Finish();
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  EXPECT_GT(num_progress, 1U);
  ASSERT_TRUE(message.has_result()) << "it comes last";
  EXPECT_TRUE(message.result().applied());
  EXPECT_EQ(message.result().num_frames(), 3U) << "the first holds the map's frame";
  EXPECT_LT(message.result().final_rmse_px(), message.result().initial_rmse_px());

  request.set_name("attic");
  grpc::ClientContext context;
  SetDeadline(context);
  const auto reader = admin_service().OptimizeMap(&context, request);
  EXPECT_FALSE(reader->Read(&message));
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(RpcTest, MapsAreListedShownAndDeleted) {
  const SessionId session = Open("hall");
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse uploaded;
  ASSERT_TRUE(Upload(View(stand, stand, session, 0), uploaded).ok());
  const v1::MapInfo hall = GetMap("hall");
  EXPECT_GT(hall.num_tiles(), 0U);
  EXPECT_LT(hall.bounds().min().x_m(), hall.bounds().max().x_m());

  v1::DeleteMapRequest request;
  request.set_name("hall");
  v1::DeleteMapResponse deleted;
  {
    grpc::ClientContext context;
    SetDeadline(context);
    EXPECT_EQ(admin_service().DeleteMap(&context, request, &deleted).error_code(),
              grpc::StatusCode::FAILED_PRECONDITION)
        << "it has an open session";
  }
  request.set_force(true);
  {
    grpc::ClientContext context;
    SetDeadline(context);
    ASSERT_TRUE(admin_service().DeleteMap(&context, request, &deleted).ok());
  }
  EXPECT_EQ(deleted.num_frames(), 1U);
  grpc::ClientContext context;
  SetDeadline(context);
  v1::ListMapsResponse maps;
  ASSERT_TRUE(admin_service().ListMaps(&context, {}, &maps).ok());
  EXPECT_EQ(maps.maps_size(), 0);
}

TEST_F(RpcTest, SessionsAreListedWithTheirMaps) {
  Open("hall");
  const SessionId session = Open("room");
  grpc::ClientContext context;
  SetDeadline(context);
  v1::ListSessionsRequest request;
  request.set_map_name("room");
  v1::ListSessionsResponse sessions;
  ASSERT_TRUE(admin_service().ListSessions(&context, request, &sessions).ok());
  ASSERT_EQ(sessions.sessions_size(), 1);
  EXPECT_EQ(sessions.sessions(0).id(), session.value());
  EXPECT_EQ(sessions.sessions(0).map_name(), "room");
  EXPECT_EQ(sessions.sessions(0).device(), "tester");
  EXPECT_EQ(sessions.sessions(0).sensor(), v1::SENSOR_KIND_RGBD);
}

}  // namespace
}  // namespace mapp
