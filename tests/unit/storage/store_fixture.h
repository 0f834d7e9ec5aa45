#pragma once

#include "storage/map_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapp {

/// The value, or an exception that fails the test with the status as its message.
template <typename T>
T Value(StatusOr<T> result) {
  if (!result.ok()) throw std::runtime_error(result.status().ToString());
  return std::move(result).value();
}
inline void Check(const Status& status) {
  if (!status.ok()) throw std::runtime_error(status.ToString());
}

inline const Status& StatusOf(const Status& status) { return status; }
template <typename T>
const Status& StatusOf(const StatusOr<T>& result) {
  return result.status();
}
MATCHER_P(HasCode, code, absl::StatusCodeToString(code)) {
  *result_listener << StatusOf(arg).ToString();
  return StatusOf(arg).code() == code;
}

/// An empty folder, removed with all it holds.
class TempFolder {
 public:
  TempFolder();
  ~TempFolder();
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  std::string File(const std::string& name) const { return (path_ / name).string(); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Opens a store: the same content when opened again, the one before being closed or gone.
using StoreOpener = std::function<StatusOr<std::unique_ptr<MapStore>>()>;

/// A storage engine under the behavioral suite. One that joins is added to AllEngines.
struct Engine {
  std::string name;
  /// An empty store, which may live in `folder`. It dates what it writes with `unix_now_ns`, when given.
  std::function<StoreOpener(const TempFolder& folder, std::function<int64_t()> unix_now_ns)> create;
};
inline void PrintTo(const Engine& engine, std::ostream* stream) { *stream << engine.name; }
std::vector<Engine> AllEngines();
inline std::string EngineName(const ::testing::TestParamInfo<Engine>& info) { return info.param.name; }

// Records with distinct, recognizable values.
Camera TestCamera();
PointRecord TestPoint(SessionId session, uint64_t session_point, const Eigen::Vector3d& position, bool in_map = true);
FrameRecord TestFrame(MapId map, SessionId session, CameraId camera, uint32_t number, const Pose3& T_map_camera);
Pose3 PoseAt(double x_m, double y_m, double z_m);
/// Bytes that depend on `seed`, like a packet's.
std::string TestBytes(uint64_t seed, size_t size);

/// What most tests stand on: a map with a session and its camera.
struct Scene {
  MapId map;
  CameraId camera;
  SessionId session;
};
Scene AddScene(MapWriter& writer, const std::string& map_name);

/// Opens a store of the engine in a folder of its own.
class MapStoreTest : public ::testing::TestWithParam<Engine> {
 protected:
  void SetUp() override {
    open_ = GetParam().create(folder_, {});
    Reopen();
  }
  void Reopen();
  /// A second store on the same content.
  StatusOr<std::unique_ptr<MapStore>> OpenAnother() { return open_(); }

  MapStore& store() { return *store_; }
  std::unique_ptr<MapReader> Read() { return Value(store_->Read()); }
  /// Runs `change` in a transaction of its own; its exceptions come back as INTERNAL.
  Status Write(std::function<Status(MapWriter&)> change) { return store_->Write({}, std::move(change)); }
  /// For changes that cannot fail but by exception.
  void MustWrite(const std::function<void(MapWriter&)>& change);
  Scene NewScene(const std::string& map_name = "kitchen");

 private:
  TempFolder folder_;
  StoreOpener open_;
  std::unique_ptr<MapStore> store_;
};

}  // namespace mapp
