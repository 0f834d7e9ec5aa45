#include "tests/unit/server/registration/map_fixture.h"

#include "mapp/codec/keyframe_codec.h"
#include "server/service/point_stats.h"
#include "server/service/session_view.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace mapp::testing {
namespace {

constexpr size_t kTileCacheBytes = size_t{64} << 20;

std::string MakeFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "mapp-registration-XXXXXX").string();
  return ::mkdtemp(pattern.data()) == nullptr ? std::string() : pattern;
}

StatusOr<MapPointId> InsertNewPoint(MapWriter& writer, const FrameRecord& frame, const Camera& camera,
                                    const KeyframeFeature& feature) {
  PointRecord point;
  point.session = frame.session;
  point.session_point = feature.point->id;
  point.in_map = frame.in_map;
  point.position = RebuildPoint(camera, frame.T_frame_camera, feature.keypoint, feature.point->depth_m);
  const Sighting sighting{FrameId(), frame.T_frame_camera.translation(), camera.MeanFocalPx(), feature.keypoint.octave};
  InitPointStats(point, sighting, feature.descriptor, 1);
  point.observers.clear();
  return writer.InsertPoint(frame.map, point);
}

/// The frame's observations; counts those of known points in their statistics.
StatusOr<std::vector<Observation>> ObservePoints(MapWriter& writer, const FrameRecord& frame, const Camera& camera,
                                                 const Keyframe& keyframe) {
  std::vector<uint64_t> numbers;
  std::vector<uint16_t> indices;
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    if (!keyframe.features[i].point) continue;
    numbers.push_back(keyframe.features[i].point->id);
    indices.push_back(static_cast<uint16_t>(i));
  }
  MAPP_ASSIGN_OR_RETURN(const auto known, writer.FindSessionPoints(frame.session, numbers));
  std::vector<Observation> observations;
  for (size_t i = 0; i < numbers.size(); ++i) {
    const KeyframeFeature& feature = keyframe.features[indices[i]];
    Observation observation{.feature_idx = indices[i], .point = {}, .depth_m = feature.point->depth_m};
    if (known[i]) {
      observation.point = *known[i];
    } else {
      MAPP_ASSIGN_OR_RETURN(observation.point, InsertNewPoint(writer, frame, camera, feature));
    }
    observations.push_back(observation);
  }
  return observations;
}

/// Makes the stored frame an observer of its points.
Status CountObservations(MapWriter& writer, const Sighting& from, const Keyframe& keyframe,
                         const std::vector<Observation>& observations) {
  for (const Observation& observation : observations) {
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer.GetPoints(std::span(&observation.point, 1)));
    PointRecord& point = points.front();
    std::vector<Eigen::Vector3d> centers;
    for (const FrameId observer : point.observers) {
      MAPP_ASSIGN_OR_RETURN(const FrameRecord record, writer.GetFrame(observer));
      centers.push_back(record.T_frame_camera.translation());
    }
    if (centers.empty()) {
      point.observers = {from.frame};
    } else {
      Sighting sighting = from;
      sighting.octave = keyframe.features[observation.feature_idx].keypoint.octave;
      AddObservation(point, sighting, centers);
    }
    MAPP_RETURN_IF_ERROR(writer.TouchPoint(point));
  }
  return absl::OkStatus();
}

StatusOr<FrameId> StoreKeyframe(MapWriter& writer, SessionId session, const Keyframe& sent) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord record, writer.GetSession(session));
  Keyframe keyframe = sent;
  ScaleLengths(keyframe, record.scale_map_session);
  MAPP_ASSIGN_OR_RETURN(const CameraRecord camera, writer.GetCamera(record.camera));
  FrameRecord frame;
  frame.map = record.map;
  frame.session = session;
  frame.camera = record.camera;
  frame.number = keyframe.number;
  frame.stamp_ns = keyframe.stamp_ns;
  frame.in_map = record.T_map_session.has_value();
  frame.T_frame_camera = frame.in_map ? *record.T_map_session * keyframe.T_frame_camera : keyframe.T_frame_camera;
  frame.num_features = static_cast<uint32_t>(keyframe.features.size());
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations,
                        ObservePoints(writer, frame, camera.camera, keyframe));
  MAPP_ASSIGN_OR_RETURN(const FrameId id, writer.InsertFrame(frame, EncodeKeyframe(sent), observations));
  const Sighting sighting{id, frame.T_frame_camera.translation(), camera.camera.MeanFocalPx()};
  MAPP_RETURN_IF_ERROR(CountObservations(writer, sighting, keyframe, observations));
  return id;
}

}  // namespace

MapFixture::MapFixture() : folder_(MakeFolder()) {
  auto store = OpenSqliteMapStore(folder_ + "/map.db", {.sync_commits = false});
  EXPECT_TRUE(store.ok()) << store.status();
  store_ = std::move(store).value();
  tiles_ = std::make_unique<TileCache>(*store_, kTileCacheBytes);
  const Status status = store_->Write({}, [this](MapWriter& writer) -> Status {
    MapRecord map;
    map.name = "place";
    MAPP_ASSIGN_OR_RETURN(map_, writer.CreateMap(map));
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
}

MapFixture::~MapFixture() {
  tiles_.reset();
  EXPECT_TRUE(store_->Close().ok());
  store_.reset();
  std::filesystem::remove_all(folder_);
}

SessionId MapFixture::OpenSession(const Camera& camera, bool founder, SensorKind sensor, double scale) {
  SessionId id;
  const Status status = store_->Write({}, [&](MapWriter& writer) -> Status {
    SessionRecord session;
    session.map = map_;
    session.device = "device";
    session.sensor = sensor;
    MAPP_ASSIGN_OR_RETURN(session.camera, writer.InsertCamera(camera));
    MAPP_ASSIGN_OR_RETURN(id, writer.InsertSession(session));
    if (!founder) return absl::OkStatus();
    MAPP_RETURN_IF_ERROR(writer.SetFounder(map_, id));
    MAPP_ASSIGN_OR_RETURN(session, writer.GetSession(id));
    MAPP_RETURN_IF_ERROR(writer.SetMetricScale(map_, MeasuresDepth(sensor)));
    session.T_map_session = Pose3();
    session.scale_map_session = scale;
    session.aligned_at_keyframe = 0;
    return writer.UpdateSession(session);
  });
  EXPECT_TRUE(status.ok()) << status;
  return id;
}

FrameId MapFixture::Store(SessionId session, const Keyframe& keyframe) {
  FrameId id;
  const Status status = store_->Write({}, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(id, StoreKeyframe(writer, session, keyframe));
    return absl::OkStatus();
  });
  EXPECT_TRUE(status.ok()) << status;
  return id;
}

void MapFixture::CloseSession(SessionId session) {
  const Status status = store_->Write({}, [session](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
    record.closed_ns = 1;
    return writer.UpdateSession(record);
  });
  EXPECT_TRUE(status.ok()) << status;
}

std::unique_ptr<MapReader> MapFixture::Read() {
  auto reader = store_->Read();
  EXPECT_TRUE(reader.ok()) << reader.status();
  return std::move(reader).value();
}

SessionRecord MapFixture::Session(SessionId session) {
  auto record = Read()->GetSession(session);
  EXPECT_TRUE(record.ok()) << record.status();
  return std::move(record).value();
}

std::vector<FrameRecord> MapFixture::Frames(SessionId session) {
  auto frames = Read()->ListFrames(map_, session);
  EXPECT_TRUE(frames.ok()) << frames.status();
  return std::move(frames).value();
}

EventLog::EventLog(MapFixture& fixture, SessionId session)
    : subscription_(fixture.events().Subscribe(session, fixture.map(), [this](const SessionEvent& event) {
        const MutexLock lock(mutex_);
        events_.push_back(event);
        changed_.NotifyAll();
      })) {}

}  // namespace mapp::testing
