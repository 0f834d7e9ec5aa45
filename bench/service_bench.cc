// Times the service's steps on a map made from a sequence, beside a bare gRPC echo of the same sizes in the same run.
// usage: service_bench [SEQUENCE]   (default: the rendered room)

#include "bench/value_or_exit.h"
#include "cli/image_source.h"
#include "cli/sequence_source.h"
#include "echo.grpc.pb.h"
#include "mapp/client/map_client.h"
#include "mapp/client/orb_tracker.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "server/rpc/rpc_server.h"
#include "server/service/map_service.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace mapp {
namespace {

constexpr int kRounds = 20;  ///< over all keyframes
constexpr int kSamples = 1000;

class Timings {
 public:
  void Measure(const std::function<void()>& work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    MeasureSince(begin);
  }
  void MeasureSince(std::chrono::steady_clock::time_point begin) {
    ms_.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
  }
  void Print(const char* name) {
    if (ms_.empty()) return;
    std::sort(ms_.begin(), ms_.end());
    std::printf("%-52s %8zu %9.3f %9.3f\n", name, ms_.size(), ms_[ms_.size() / 2], ms_[ms_.size() * 95 / 100]);
  }

 private:
  std::vector<double> ms_;
};

class EchoService final : public bench::EchoService::Service {
  grpc::Status Echo(grpc::ServerContext*, const bench::EchoRequest* request, bench::EchoResponse* response) override {
    response->set_payload(request->payload());
    return grpc::Status::OK;
  }
};

/// An echo server on a free port, and a stub to it.
struct EchoPair {
  EchoPair() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&service);
    server = builder.BuildAndStart();
    stub = bench::EchoService::NewStub(
        grpc::CreateChannel("127.0.0.1:" + std::to_string(port), grpc::InsecureChannelCredentials()));
  }
  void Call(const std::string& payload) {
    grpc::ClientContext context;
    bench::EchoRequest request;
    request.set_payload(payload);
    bench::EchoResponse response;
    const grpc::Status status = stub->Echo(&context, request, &response);
    if (!status.ok()) std::fprintf(stderr, "service_bench: echo: %s\n", status.error_message().c_str());
  }
  EchoService service;
  std::unique_ptr<grpc::Server> server;
  std::unique_ptr<bench::EchoService::Stub> stub;
};

/// The keyframes that the built-in tracker makes of the sequence, mapping for itself.
std::vector<Keyframe> TrackKeyframes(const Sequence& sequence, OrbTracker& tracker) {
  std::vector<Keyframe> keyframes;
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    const SequenceFrame frame = ValueOrExit(sequence.Read(i), "read");
    ValueOrExit(tracker.Track({.stamp_ns = frame.stamp_ns,
                               .gray = frame.gray.View(),
                               .depth_m = frame.depth_m.View(),
                               .right_gray = frame.right_gray.View()}),
                "track");
    tracker.WaitForLocalMapping();
    for (Keyframe& keyframe : tracker.TakeKeyframes()) keyframes.push_back(std::move(keyframe));
  }
  return keyframes;
}

ViewQuery QueryOf(const Keyframe& keyframe, const Camera& camera) {
  std::vector<Eigen::Vector3d> points;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (!feature.point) continue;
    points.push_back(feature.point->depth_m * camera.Unproject({feature.keypoint.u_px, feature.keypoint.v_px}));
  }
  return {.pose_frame = PoseFrame::kSession,
          .T_frame_camera = keyframe.T_frame_camera,
          .sampler = SamplerKind::kDepthSketch,
          .sketch = MakeDepthSketch(camera, points)};
}

int Run(const std::string& sequence_name) {
  const std::unique_ptr<Sequence> sequence = ValueOrExit(OpenSequenceSource(sequence_name), "open the sequence");
  const std::unique_ptr<OrbTracker> tracker = ValueOrExit(MakeTracker(*sequence), "make the tracker");
  std::vector<Keyframe> keyframes = TrackKeyframes(*sequence, *tracker);

  std::string folder = (std::filesystem::temp_directory_path() / "mapp-bench-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) OkOrExit(absl::InternalError("no temporary folder"), folder.c_str());
  const std::unique_ptr<MapStore> store =
      ValueOrExit(OpenSqliteMapStore(folder + "/map.db", SqliteOptions{}), "open the store");
  const std::unique_ptr<MapService> service = ValueOrExit(MapService::Create(*store, {}), "create the service");
  RpcServerOptions rpc_options;
  rpc_options.listen_address = "127.0.0.1:0";
  const std::unique_ptr<RpcServer> rpc = ValueOrExit(RpcServer::Start(*service, rpc_options), "start the server");
  const std::unique_ptr<MapClient> client = ValueOrExit(
      MapClient::Create({.server_address = "127.0.0.1:" + std::to_string(rpc->port())}), "create the client");

  const CallContext context = CallContext::WithTimeout(std::chrono::minutes(10));
  const OpenedSession opened = ValueOrExit(service->OpenSession(context, {.map_name = "bench",
                                                                          .device = "bench",
                                                                          .sensor = tracker->sensor(),
                                                                          .camera = tracker->camera(),
                                                                          .create_map = true}),
                                           "open a session");
  std::printf("%-52s %8s %9s %9s\n", "step", "runs", "p50 ms", "p95 ms");
  Timings integrate;
  size_t packet_bytes = 0;
  for (Keyframe& keyframe : keyframes) {
    keyframe.session = opened.session;
    const std::string packet = EncodeKeyframe(keyframe);
    packet_bytes = std::max(packet_bytes, packet.size());
    integrate.Measure([&] { ValueOrExit(service->UploadKeyframe(context, packet), "upload"); });
  }
  integrate.Print("integrate a whole keyframe, durable (in the server)");

  Timings assess;
  Timings assess_rpc;
  Timings echo_small;
  Timings share;
  Timings share_first;
  Timings share_rpc;
  Timings echo_packet;
  EchoPair echo;
  size_t shared_bytes = 0;
  for (int round = 0; round < kRounds; ++round) {
    for (const Keyframe& keyframe : keyframes) {
      const ViewQuery view = QueryOf(keyframe, tracker->camera());
      assess.Measure([&] { ValueOrExit(service->AssessOverlap(context, opened.session, view, kSamples), "assess"); });
      assess_rpc.Measure(
          [&] { ValueOrExit(client->AssessOverlap(opened.session, keyframe.number, view, kSamples), "assess"); });
      echo_small.Measure([&] { echo.Call(std::string(60, 'q')); });
      echo_packet.Measure([&] { echo.Call(std::string(packet_bytes, 'k')); });
      if (round > 1) continue;
      const auto begin = std::chrono::steady_clock::now();
      bool first = true;
      shared_bytes = 0;
      share.Measure([&] {
        ValueOrExit(service->RequestSharedMap(context, {.session = opened.session, .view = view, .held_tiles = {}},
                                              [&](const std::string& tile) {
                                                if (first) share_first.MeasureSince(begin);
                                                first = false;
                                                shared_bytes += tile.size();
                                                return absl::OkStatus();
                                              }),
                    "share");
      });
      ClientSharedMapRequest wanted;
      wanted.keyframe = keyframe.number;
      wanted.view = view;
      share_rpc.Measure([&] { ValueOrExit(client->RequestSharedMap(opened.session, wanted), "share"); });
    }
  }
  assess.Print("AssessOverlap, 1000 samples (in the server)");
  assess_rpc.Print("AssessOverlap over gRPC, loopback");
  echo_small.Print("bare gRPC echo of 60 bytes");
  share_first.Print("RequestSharedMap, first tile (in the server)");
  share.Print("RequestSharedMap, whole (in the server)");
  share_rpc.Print("RequestSharedMap over gRPC, decoded by the device");
  echo_packet.Print("bare gRPC echo of a keyframe packet");
  const MapRecord map = ValueOrExit(service->GetMap(context, "bench", ""), "get the map").record;
  std::printf("map: %ld frames, %ld points; packet at most %zu bytes; shared map %zu bytes\n",
              static_cast<long>(map.num_frames), static_cast<long>(map.num_points), packet_bytes, shared_bytes);
  rpc->Shutdown(std::chrono::seconds(1));
  service->Shutdown();
  OkOrExit(store->Close(), "close the store");
  std::filesystem::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) { return mapp::Run(argc > 1 ? argv[1] : "sim:room/0"); }
