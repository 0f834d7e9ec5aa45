// A map of millions of points behind a real server: how long it takes to start, what it holds in memory, how fast it
// answers in places that it has in memory and in those it has not, and how many uploads it acknowledges from 16
// clients.
//
//   scale_bench make DATABASE [POINTS]    writes the map, 10 million points unless told otherwise
//   scale_bench serve DATABASE [CACHE_MB] measures a server on it
#include "bench/value_or_exit.h"
#include "eval/process/child_process.h"
#include "mapp/base/rng.h"
#include "mapp/client/map_client.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

namespace mapp {
namespace {

using Clock = std::chrono::steady_clock;

constexpr char kMapName[] = "large";
constexpr int kPointsAFrame = 500;
/// An open session that `make` leaves: it need not find its place first.
const SessionId kAsker(2);
/// Frames stand in a square, this far apart: 56 points a square metre of ground, as in a garage walked many times.
constexpr double kSpacingM = 3;
constexpr double kNearM = 2, kFarM = 15;
constexpr int kNumClients = 16;
constexpr int kUploadsAClient = 60;

Camera BenchCamera() {
  Camera camera;
  camera.projection = PinholeCamera{.fx = 525, .fy = 525, .cx = 320, .cy = 240};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

/// Where frame `i` of `n` stands; it looks about.
Pose3 PoseOf(int i, int n) {
  const int side = std::max(1, static_cast<int>(std::ceil(std::sqrt(n))));
  const double heading = 2.4 * i;
  const Eigen::Quaterniond q(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitY()));
  return Pose3(q, {kSpacingM * (i % side), 0, kSpacingM * (i / side)});
}

/// A keyframe with points nobody has seen before.
Keyframe RandomKeyframe(SessionId session, uint32_t number, const Pose3& T_session_camera, uint64_t first_point,
                        Rng& rng) {
  Keyframe keyframe;
  keyframe.session = session;
  keyframe.number = number;
  keyframe.stamp_ns = int64_t{1'000'000'000} + int64_t{100'000'000} * number;
  keyframe.T_frame_camera = T_session_camera;
  for (int i = 0; i < kPointsAFrame; ++i) {
    KeyframeFeature feature;
    feature.keypoint.u_px = static_cast<float>(rng.Uniform(0, 639));
    feature.keypoint.v_px = static_cast<float>(rng.Uniform(0, 479));
    feature.descriptor = RandomDescriptor(rng);
    PointReference point;
    point.id = first_point + static_cast<uint64_t>(i);
    point.depth_m = static_cast<float>(rng.Uniform(kNearM, kFarM));
    point.num_observations = 3;
    feature.point = point;
    keyframe.features.push_back(feature);
  }
  return keyframe;
}

Status WriteFrame(MapWriter& writer, MapId map, CameraId camera, const Keyframe& keyframe) {
  FrameRecord frame;
  frame.map = map;
  frame.session = keyframe.session;
  frame.camera = camera;
  frame.number = keyframe.number;
  frame.stamp_ns = keyframe.stamp_ns;
  frame.in_map = true;
  frame.T_frame_camera = keyframe.T_frame_camera;
  frame.num_features = static_cast<uint32_t>(keyframe.features.size());
  MAPP_ASSIGN_OR_RETURN(const FrameId id, writer.InsertFrame(frame, EncodeKeyframe(keyframe), {}));
  const Camera pinhole = BenchCamera();
  std::vector<Observation> observations;
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    const KeyframeFeature& feature = keyframe.features[i];
    PointRecord point;
    point.session = keyframe.session;
    point.session_point = feature.point->id;
    point.in_map = true;
    point.position = keyframe.T_frame_camera * (static_cast<double>(feature.point->depth_m) *
                                                pinhole.Unproject({feature.keypoint.u_px, feature.keypoint.v_px}));
    point.view_direction = (point.position - keyframe.T_frame_camera.translation()).normalized().cast<float>();
    point.descriptor = feature.descriptor;
    point.reference_distance_m = feature.point->depth_m;
    point.num_observations = 3;
    point.observers = {id};
    MAPP_ASSIGN_OR_RETURN(const MapPointId point_id, writer.InsertPoint(map, point));
    observations.push_back({static_cast<uint16_t>(i), point_id, feature.point->depth_m});
  }
  return writer.SetObservations(id, observations);
}

/// At the map's own frame.
StatusOr<SessionId> AddAlignedSession(MapWriter& writer, MapId map, CameraId camera) {
  SessionRecord record;
  record.map = map;
  record.camera = camera;
  record.device = "bench";
  record.T_map_session = Pose3();
  record.aligned_at_keyframe = 0;
  MAPP_ASSIGN_OR_RETURN(record.id, writer.InsertSession(record));
  MAPP_RETURN_IF_ERROR(writer.UpdateSession(record));
  return record.id;
}

void Make(const std::string& file, int64_t num_points) {
  const auto store = ValueOrExit(OpenSqliteMapStore(file, {.sync_commits = false, .writer_cache_kb = 512 * 1024}));
  MapId map;
  CameraId camera;
  SessionId session;
  OkOrExit(store->Write({}, [&](MapWriter& writer) -> Status {
    MapRecord record;
    record.name = kMapName;
    MAPP_ASSIGN_OR_RETURN(map, writer.CreateMap(record));
    MAPP_ASSIGN_OR_RETURN(camera, writer.InsertCamera(BenchCamera()));
    MAPP_ASSIGN_OR_RETURN(session, AddAlignedSession(writer, map, camera));
    MAPP_RETURN_IF_ERROR(writer.SetFounder(map, session));
    MAPP_ASSIGN_OR_RETURN(const SessionId asker, AddAlignedSession(writer, map, camera));
    return asker == kAsker ? absl::OkStatus() : absl::AlreadyExistsError("not a new file");
  }));
  Rng rng(1);
  const auto num_frames = static_cast<int>(num_points / kPointsAFrame);
  constexpr int kFramesACommit = 50;
  const Clock::time_point start = Clock::now();
  for (int first = 0; first < num_frames; first += kFramesACommit) {
    OkOrExit(store->Write({}, [&](MapWriter& writer) -> Status {
      for (int i = first; i < std::min(first + kFramesACommit, num_frames); ++i) {
        const Keyframe keyframe = RandomKeyframe(session, static_cast<uint32_t>(i), PoseOf(i, num_frames),
                                                 static_cast<uint64_t>(i) * kPointsAFrame, rng);
        MAPP_RETURN_IF_ERROR(WriteFrame(writer, map, camera, keyframe));
      }
      return absl::OkStatus();
    }));
    if (first % 5000 == 0) fmt::print("{} of {} frames\n", first, num_frames);
  }
  OkOrExit(store->Write({}, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord closed, writer.GetSession(session));
    closed.closed_ns = 1;
    MAPP_ASSIGN_OR_RETURN(const MapRecord record, writer.GetMap(map));
    closed.optimized = record.revision;
    return writer.UpdateSession(closed);
  }));
  OkOrExit(store->Close());
  fmt::print("{} frames, {} points in {:.0f} s; {:.1f} GB\n", num_frames, num_frames * kPointsAFrame,
             std::chrono::duration<double>(Clock::now() - start).count(),
             static_cast<double>(std::filesystem::file_size(file)) / 1e9);
}

double MillisecondsOf(const std::function<void()>& work) {
  const Clock::time_point start = Clock::now();
  work();
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

void PrintTimes(const std::string& what, std::vector<double> ms) {
  std::ranges::sort(ms);
  fmt::print("{:<34} median {:7.2f} ms, p95 {:7.2f} ms, of {}\n", what, ms[ms.size() / 2], ms[ms.size() * 95 / 100],
             ms.size());
}

/// A view of the place where frame `i` stood, as a device asks for it.
ViewQuery QueryAt(int i, int num_frames) {
  ViewQuery view;
  view.pose_frame = PoseFrame::kMap;
  view.T_frame_camera = PoseOf(i, num_frames);
  view.sampler = SamplerKind::kUniform;
  return view;
}

struct Server {
  std::unique_ptr<ChildProcess> process;
  std::string address;
  double start_ms = 0;

  double ResidentMb() const { return static_cast<double>(ValueOrExit(process->Usage()).rss_bytes) / 1048576; }
  double PeakMb() const { return static_cast<double>(ValueOrExit(process->Usage()).peak_rss_bytes) / 1048576; }
};

Server StartServer(const std::string& file, const std::string& cache_mb) {
  Server server;
  const std::string port_file = file + ".port";
  std::filesystem::remove(port_file);
  ChildOptions options;
  options.command = {MAPP_SERVER_BINARY, "--db",       file,     "--listen",    "127.0.0.1:0", "--port-file",
                     port_file,          "--cache-mb", cache_mb, "--log-level", "warning"};
  options.output_file = file + ".log";
  options.error_file = file + ".err";
  server.start_ms = MillisecondsOf([&] {
    server.process = ValueOrExit(ChildProcess::Start(options));
    std::string port;
    while (port.empty()) {
      std::ifstream(port_file) >> port;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    server.address = "127.0.0.1:" + port;
  });
  return server;
}

ClientSession OpenSession(MapClient& client, const std::string& device) {
  return ValueOrExit(client.OpenSession(kMapName, device, SensorKind::kRgbd, BenchCamera(), {}, false), "open session");
}

/// Median of the answers that fit what the server holds, and of those that do not.
void AskAround(MapClient& client, SessionId session, int num_frames, const Server& server) {
  Rng rng(7);
  constexpr size_t kNumSamples = 300;
  const auto ask = [&](int i) {
    return MillisecondsOf([&] {
      OkOrExit(client.AssessOverlap(session, 0, QueryAt(i, num_frames), kNumSamples).status(), "assess overlap");
    });
  };
  std::vector<double> cold_ms, warm_ms;
  for (int i = 0; i < 400; ++i) {
    const auto place = static_cast<int>(rng.Below(static_cast<uint64_t>(num_frames)));
    cold_ms.push_back(ask(place));
    for (int again = 0; again < 3; ++again) warm_ms.push_back(ask(place));
  }
  PrintTimes("AssessOverlap, cold", cold_ms);
  PrintTimes("AssessOverlap, warm", warm_ms);
  fmt::print("{:<34} {:.0f} MB resident, {:.0f} at most\n", "after 400 places", server.ResidentMb(), server.PeakMb());
}

void ShareAround(MapClient& client, SessionId session, int num_frames, const Server& server) {
  Rng rng(11);
  std::vector<double> first_ms, again_ms;
  uint64_t num_bytes = 0;
  for (int i = 0; i < 100; ++i) {
    const auto place = static_cast<int>(rng.Below(static_cast<uint64_t>(num_frames)));
    ClientSharedMapRequest wanted;
    wanted.view = QueryAt(place, num_frames);
    const auto share = [&] {
      const ClientSharedMap shared = ValueOrExit(client.RequestSharedMap(session, wanted), "shared map");
      for (const ClientTile& tile : shared.tiles) num_bytes += tile.tile.points.size();
    };
    first_ms.push_back(MillisecondsOf(share));
    again_ms.push_back(MillisecondsOf(share));
  }
  PrintTimes("RequestSharedMap, first", first_ms);
  PrintTimes("RequestSharedMap, again", again_ms);
  fmt::print("{:<34} {:.0f} points; {:.0f} MB resident, {:.0f} at most\n", "of each",
             static_cast<double>(num_bytes) / 200, server.ResidentMb(), server.PeakMb());
}

/// Each client a fragment of its own: the registrar compares what they send with the whole map meanwhile.
void UploadFromAll(const Server& server, int num_frames) {
  std::atomic<int> num_acknowledged = 0;
  std::vector<std::vector<std::string>> packets(kNumClients);
  std::vector<std::unique_ptr<MapClient>> clients;
  size_t num_bytes = 0;
  for (int c = 0; c < kNumClients; ++c) {
    MapClientOptions options;
    options.server_address = server.address;
    options.call_timeout = std::chrono::minutes(2);
    clients.push_back(ValueOrExit(MapClient::Create(options)));
    const SessionId session = OpenSession(*clients.back(), fmt::format("client{}", c)).id;
    Rng rng(100 + static_cast<uint64_t>(c));
    for (int i = 0; i < kUploadsAClient; ++i) {
      const Pose3 pose = PoseOf(i, num_frames);
      packets[static_cast<size_t>(c)].push_back(
          EncodeKeyframe(RandomKeyframe(session, static_cast<uint32_t>(i), pose, 1 + uint64_t{1000} * i, rng)));
      num_bytes += packets[static_cast<size_t>(c)].back().size();
    }
  }
  // What the index of places takes when a map is first touched is told apart.
  const double first_ms =
      MillisecondsOf([&] { OkOrExit(clients[0]->UploadKeyframe(packets[0][0]).status(), "the first upload"); });
  fmt::print("{:<34} {:.2f} ms\n", "first upload", first_ms);
  const Clock::time_point start = Clock::now();
  {
    std::vector<std::jthread> threads;
    for (int c = 0; c < kNumClients; ++c) {
      threads.emplace_back([&, c] {
        for (const std::string& packet : packets[static_cast<size_t>(c)]) {
          OkOrExit(clients[static_cast<size_t>(c)]->UploadKeyframe(packet).status(), "upload");
          ++num_acknowledged;
        }
      });
    }
  }
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  fmt::print("{:<34} {:.0f} a second of {:.1f} KB, {} points each, from {} clients\n", "acknowledged uploads",
             num_acknowledged / seconds, static_cast<double>(num_bytes) / num_acknowledged / 1024, kPointsAFrame,
             kNumClients);
  fmt::print("{:<34} {:.0f} MB resident, {:.0f} at most\n", "after it", server.ResidentMb(), server.PeakMb());
}

void Serve(const std::string& file, const std::string& cache_mb) {
  int num_frames = 0;
  {
    const auto store = ValueOrExit(OpenSqliteMapStore(file, {.read_only = true}));
    const MapRecord map = ValueOrExit(ValueOrExit(store->Read())->FindMap(kMapName));
    num_frames = static_cast<int>(map.num_frames);
    fmt::print("{} points, {} frames, cache {} MB\n", map.num_points, map.num_frames, cache_mb);
  }
  const Server server = StartServer(file, cache_mb);
  fmt::print("{:<34} {:.0f} ms, {:.0f} MB resident\n", "start", server.start_ms, server.ResidentMb());
  MapClientOptions options;
  options.server_address = server.address;
  options.call_timeout = std::chrono::minutes(2);
  const auto client = ValueOrExit(MapClient::Create(options));
  AskAround(*client, kAsker, num_frames, server);
  ShareAround(*client, kAsker, num_frames, server);
  UploadFromAll(server, num_frames);
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.size() >= 2 && arguments[0] == "make") {
    mapp::Make(arguments[1], arguments.size() > 2 ? std::stoll(arguments[2]) : 10'000'000);
    return 0;
  }
  if (arguments.size() >= 2 && arguments[0] == "serve") {
    mapp::Serve(arguments[1], arguments.size() > 2 ? arguments[2] : "256");
    return 0;
  }
  fmt::print(stderr, "usage: scale_bench make DATABASE [POINTS] | serve DATABASE [CACHE_MB]\n");
  return 2;
}
