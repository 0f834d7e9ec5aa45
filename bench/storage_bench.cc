// What one keyframe's upload costs the map database, and how many a second are acknowledged from many threads, beside
// a bare SQLite loop that commits as many packets.
#include "mapp/base/rng.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <benchmark/benchmark.h>
#include <sqlite3.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapp {
namespace {

constexpr size_t kPacketBytes = 43'000;
constexpr int kNewPoints = 500;
constexpr int kSeenPoints = 500;

template <typename T>
T Value(StatusOr<T> result) {
  if (!result.ok()) throw std::runtime_error(result.status().ToString());
  return std::move(result).value();
}
void Check(const Status& status) {
  if (!status.ok()) throw std::runtime_error(status.ToString());
}

/// A store in a folder of its own, with one map and session.
class BenchStore {
 public:
  explicit BenchStore(const SqliteOptions& options = {}) {
    std::string pattern = (std::filesystem::temp_directory_path() / "mapp_storage_bench_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = pattern;
    store_ = Value(OpenSqliteMapStore(folder_ + "/maps.db", options));
    Check(store_->Write({}, [this](MapWriter& writer) -> Status {
      MapRecord map;
      map.name = "bench";
      MAPP_ASSIGN_OR_RETURN(map_, writer.CreateMap(map));
      Camera camera;
      camera.projection = PinholeCamera{.fx = 500, .fy = 500, .cx = 320, .cy = 240};
      camera.width_px = 640;
      camera.height_px = 480;
      MAPP_ASSIGN_OR_RETURN(camera_, writer.InsertCamera(camera));
      return absl::OkStatus();
    }));
    session_ = AddSession();
  }
  ~BenchStore() {
    store_.reset();
    std::error_code error;
    std::filesystem::remove_all(folder_, error);
  }

  SessionId AddSession() {
    SessionId session;
    Check(store_->Write({}, [&](MapWriter& writer) -> Status {
      SessionRecord record;
      record.map = map_;
      record.camera = camera_;
      MAPP_ASSIGN_OR_RETURN(session, writer.InsertSession(record));
      return absl::OkStatus();
    }));
    return session;
  }

  FrameRecord Frame(SessionId session, uint32_t number) const {
    FrameRecord frame;
    frame.map = map_;
    frame.session = session;
    frame.camera = camera_;
    frame.number = number;
    frame.in_map = true;
    frame.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3 * number, 0, 0));
    return frame;
  }

  PointRecord Point(SessionId session, uint64_t session_point, const Eigen::Vector3d& position) const {
    PointRecord point;
    point.session = session;
    point.session_point = session_point;
    point.in_map = true;
    point.position = position;
    point.observers = {FrameId(1), FrameId(2)};
    return point;
  }

  MapStore& store() { return *store_; }
  MapId map() const { return map_; }
  SessionId session() const { return session_; }
  std::string file() const { return folder_ + "/maps.db"; }
  int64_t FileBytes() const { return static_cast<int64_t>(std::filesystem::file_size(folder_ + "/maps.db")); }

 private:
  std::string folder_;
  std::unique_ptr<MapStore> store_;
  MapId map_;
  CameraId camera_;
  SessionId session_;
};

/// One whole keyframe: 43 KB packet, 1000 device numbers looked up, 500 new points, 500 known ones touched.
void UploadKeyframe(BenchStore& bench, SessionId session, uint32_t number, const std::string& packet, Rng& rng) {
  Check(bench.store().Write({}, [&](MapWriter& writer) -> Status {
    const uint64_t first_point = uint64_t{number} * kNewPoints;
    std::vector<uint64_t> numbers;
    for (uint64_t i = 0; i < kNewPoints + kSeenPoints; ++i) {
      numbers.push_back(first_point + i >= kSeenPoints ? first_point + i - kSeenPoints : first_point + i);
    }
    MAPP_ASSIGN_OR_RETURN(const auto known, writer.FindSessionPoints(session, numbers));
    std::vector<Observation> observations;
    for (size_t i = 0; i < kSeenPoints && number > 0; ++i) {
      MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> seen, writer.GetPoints(std::span(&*known[i], 1)));
      ++seen[0].num_observations;
      MAPP_RETURN_IF_ERROR(writer.TouchPoint(seen[0]));
      observations.push_back({.feature_idx = static_cast<uint16_t>(i), .point = seen[0].id, .depth_m = 3});
    }
    for (uint64_t i = 0; i < kNewPoints; ++i) {
      const Eigen::Vector3d position(0.3 * number + rng.Uniform(-4, 4), rng.Uniform(-3, 3), rng.Uniform(1, 9));
      MAPP_ASSIGN_OR_RETURN(const MapPointId point,
                            writer.InsertPoint(bench.map(), bench.Point(session, first_point + i, position)));
      observations.push_back({.feature_idx = static_cast<uint16_t>(kSeenPoints + i), .point = point, .depth_m = 3});
    }
    return writer.InsertFrame(bench.Frame(session, number), packet, observations).status();
  }));
}

void BM_KeyframeTransaction(benchmark::State& state) {
  BenchStore bench({.page_checksums = state.range(0) != 0});
  Rng rng(1);
  const std::string packet(kPacketBytes, 'p');
  uint32_t number = 0;
  for (auto _ : state) UploadKeyframe(bench, bench.session(), number++, packet, rng);
  Check(bench.store().Close());
  state.counters["KB/keyframe"] = static_cast<double>(bench.FileBytes()) / 1e3 / number;
}
BENCHMARK(BM_KeyframeTransaction)
    ->ArgName("checksums")
    ->Arg(0)
    ->Arg(1)
    ->Unit(benchmark::kMillisecond)
    ->Iterations(200)
    ->UseRealTime();

/// Packets that are in the system's file cache but not in SQLite's: what checking pages costs where it costs most.
void BM_ReadPackets(benchmark::State& state) {
  constexpr uint32_t kNumPackets = 200;
  BenchStore bench({.page_checksums = state.range(0) != 0});
  std::vector<FrameId> frames;
  for (uint32_t i = 0; i < kNumPackets; ++i) {
    Check(bench.store().Write({}, [&](MapWriter& writer) -> Status {
      MAPP_ASSIGN_OR_RETURN(const FrameId frame,
                            writer.InsertFrame(bench.Frame(bench.session(), i), std::string(kPacketBytes, 'p'), {}));
      frames.push_back(frame);
      return absl::OkStatus();
    }));
  }
  Check(bench.store().Close());
  for (auto _ : state) {
    const auto store = Value(OpenSqliteMapStore(bench.file(), {.read_only = true, .reader_cache_kb = 100}));
    const auto reader = Value(store->Read());
    for (const FrameId frame : frames) benchmark::DoNotOptimize(Value(reader->GetPacket(frame)));
  }
  state.SetBytesProcessed(state.iterations() * kNumPackets * static_cast<int64_t>(kPacketBytes));
}
BENCHMARK(BM_ReadPackets)->ArgName("checksums")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void BM_PointsInTile(benchmark::State& state) {
  BenchStore bench;
  Rng rng(1);
  const auto num_points = static_cast<uint64_t>(state.range(0));
  Check(bench.store().Write({}, [&](MapWriter& writer) -> Status {
    for (uint64_t i = 0; i < num_points; ++i) {
      const Eigen::Vector3d position(rng.Uniform(0, 8), rng.Uniform(0, 8), rng.Uniform(0, 8));
      MAPP_RETURN_IF_ERROR(writer.InsertPoint(bench.map(), bench.Point(bench.session(), i, position)).status());
    }
    return absl::OkStatus();
  }));
  const auto reader = Value(bench.store().Read());
  for (auto _ : state) benchmark::DoNotOptimize(Value(reader->PointsInTile(bench.map(), {0, 0, 0})));
}
BENCHMARK(BM_PointsInTile)->Arg(1000)->Arg(20000)->Unit(benchmark::kMillisecond);

/// Acknowledged uploads of packets alone, each thread a session of its own.
class Uploads : public benchmark::Fixture {
 public:
  void SetUp(const benchmark::State&) override {
    const std::scoped_lock lock(mutex_);
    if (bench_ == nullptr) bench_ = std::make_unique<BenchStore>();
  }
  void TearDown(const benchmark::State&) override {
    const std::scoped_lock lock(mutex_);
    bench_.reset();
  }

 protected:
  std::mutex mutex_;
  std::unique_ptr<BenchStore> bench_;
};

BENCHMARK_DEFINE_F(Uploads, Acknowledged)(benchmark::State& state) {
  const SessionId session = bench_->AddSession();
  const std::string packet(kPacketBytes, 'p');
  uint32_t number = 0;
  for (auto _ : state) {
    Check(bench_->store().Write({}, [&](MapWriter& writer) {
      return writer.InsertFrame(bench_->Frame(session, number), packet, {}).status();
    }));
    ++number;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_REGISTER_F(Uploads, Acknowledged)->Threads(1)->Threads(16)->Iterations(100)->UseRealTime();

/// The measure of it: as many packets a commit as there are threads above, by SQLite alone.
void BM_BareSqlite(benchmark::State& state) {
  std::string pattern = (std::filesystem::temp_directory_path() / "mapp_storage_bench_XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
  sqlite3* db = nullptr;
  sqlite3_open((pattern + "/bare.db").c_str(), &db);
  sqlite3_exec(db,
               "PRAGMA page_size = 16384; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
               "CREATE TABLE log (id INTEGER PRIMARY KEY, packet BLOB)",
               nullptr, nullptr, nullptr);
  sqlite3_stmt* insert = nullptr;
  sqlite3_prepare_v2(db, "INSERT INTO log (packet) VALUES (?)", -1, &insert, nullptr);
  const std::string packet(kPacketBytes, 'p');
  for (auto _ : state) {
    sqlite3_exec(db, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr);
    for (int i = 0; i < state.range(0); ++i) {
      sqlite3_bind_blob(insert, 1, packet.data(), static_cast<int>(packet.size()), SQLITE_STATIC);
      sqlite3_step(insert);
      sqlite3_reset(insert);
    }
    if (sqlite3_exec(db, "COMMIT", nullptr, nullptr, nullptr) != SQLITE_OK) state.SkipWithError(sqlite3_errmsg(db));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
  sqlite3_finalize(insert);
  sqlite3_close(db);
  std::error_code error;
  std::filesystem::remove_all(pattern, error);
}
BENCHMARK(BM_BareSqlite)->Arg(1)->Arg(16)->Iterations(100)->UseRealTime();

}  // namespace
}  // namespace mapp

BENCHMARK_MAIN();
