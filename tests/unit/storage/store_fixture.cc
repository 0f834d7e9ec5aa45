#include "tests/unit/storage/store_fixture.h"

#include "mapp/base/rng.h"
#include "storage/memory/memory_map_store.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <cstdlib>

namespace mapp {

TempFolder::TempFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "mapp_storage_XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
  path_ = pattern;
}

TempFolder::~TempFolder() {
  std::error_code error;
  std::filesystem::remove_all(path_, error);
}

std::vector<Engine> AllEngines() {
  const auto create_sqlite = [](const TempFolder& folder, std::function<int64_t()> unix_now_ns) -> StoreOpener {
    // No test of the suite cuts the power: spare a busy disk. Closing waits that long for a reader that stays open.
    SqliteOptions options{.busy_timeout = std::chrono::milliseconds(500), .sync_commits = false};
    if (unix_now_ns) options.unix_now_ns = std::move(unix_now_ns);
    return [file = folder.File("maps.db"), options] { return OpenSqliteMapStore(file, options); };
  };
  const auto create_memory = [](const TempFolder&, std::function<int64_t()> unix_now_ns) -> StoreOpener {
    MemoryOptions options;
    if (unix_now_ns) options.unix_now_ns = std::move(unix_now_ns);
    return [database = CreateMemoryDatabase(), options] { return OpenMemoryMapStore(database, options); };
  };
  return {{.name = "Sqlite", .create = create_sqlite}, {.name = "Memory", .create = create_memory}};
}

Camera TestCamera() {
  Camera camera;
  camera.projection = RadialTangentialCamera{
      .fx = 458.654, .fy = 457.296, .cx = 367.215, .cy = 248.375, .k1 = -0.28, .k2 = 0.07, .p1 = 2e-4, .p2 = 1.8e-5};
  camera.width_px = 752;
  camera.height_px = 480;
  camera.stereo_baseline_m = 0.11;
  return camera;
}

PointRecord TestPoint(SessionId session, uint64_t session_point, const Eigen::Vector3d& position, bool in_map) {
  PointRecord point;
  point.session = session;
  point.session_point = session_point;
  point.in_map = in_map;
  point.position = position;
  point.view_direction = Eigen::Vector3f(0.6F, 0, 0.8F);
  const std::string bytes = TestBytes(session_point, OrbDescriptor::kBytes);
  point.descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(bytes.data()));
  point.reference_distance_m = 3.25F;
  point.num_observations = 2;
  point.confidence = 0.75F;
  point.observers = {FrameId(1), FrameId(1000)};
  return point;
}

FrameRecord TestFrame(MapId map, SessionId session, CameraId camera, uint32_t number, const Pose3& T_map_camera) {
  FrameRecord frame;
  frame.map = map;
  frame.session = session;
  frame.camera = camera;
  frame.number = number;
  frame.stamp_ns = 1'400'000'000'000'000'000 + number;
  frame.in_map = true;
  frame.T_frame_camera = T_map_camera;
  frame.num_features = 800;
  return frame;
}

Pose3 PoseAt(double x_m, double y_m, double z_m) {
  return Pose3(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), Eigen::Vector3d(x_m, y_m, z_m));
}

std::string TestBytes(uint64_t seed, size_t size) {
  Rng rng(seed);
  std::string bytes(size, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.Next());
  return bytes;
}

Scene AddScene(MapWriter& writer, const std::string& map_name) {
  Scene scene;
  scene.map = Value(writer.CreateMap({.id = {}, .name = map_name, .created_ns = 0, .revision = {}, .founder = {}}));
  scene.camera = Value(writer.InsertCamera(TestCamera()));
  SessionRecord session;
  session.map = scene.map;
  session.camera = scene.camera;
  session.device = "robot-7";
  session.sensor = SensorKind::kStereo;
  scene.session = Value(writer.InsertSession(session));
  return scene;
}

void MapStoreTest::Reopen() {
  store_.reset();
  store_ = Value(open_());
}

void MapStoreTest::MustWrite(const std::function<void(MapWriter&)>& change) {
  Check(Write([&](MapWriter& writer) {
    change(writer);
    return absl::OkStatus();
  }));
}

Scene MapStoreTest::NewScene(const std::string& map_name) {
  Scene scene;
  MustWrite([&](MapWriter& writer) { scene = AddScene(writer, map_name); });
  return scene;
}

}  // namespace mapp
