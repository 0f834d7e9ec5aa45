#include "tests/unit/server/bundle/bundle_fixture.h"

#include "mapp/codec/keyframe_codec.h"
#include "server/service/map_history.h"
#include "storage/memory/memory_map_store.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <set>

namespace mapp::testing {
namespace {

constexpr int64_t kExportedNs = 1'700'000'000'000'000'000;

/// Session, frame and point ids of one map, by those of the other.
struct SameIds {
  std::map<SessionId, SessionId> sessions;
  std::map<FrameId, FrameId> frames;
  std::map<MapPointId, MapPointId> points;
};

void ExpectSamePose(const Pose3& a, const Pose3& b) {
  EXPECT_EQ(a.translation(), b.translation());
  EXPECT_EQ(a.rotation().coeffs(), b.rotation().coeffs());
}

void ExpectSameSession(const SessionRecord& a, const SessionRecord& b) {
  EXPECT_EQ(a.device, b.device);
  EXPECT_EQ(a.sensor, b.sensor);
  EXPECT_EQ(a.opened_ns, b.opened_ns);
  EXPECT_EQ(a.closed_ns.value_or(kExportedNs), b.closed_ns);
  ASSERT_EQ(a.T_map_session.has_value(), b.T_map_session.has_value());
  if (a.T_map_session) ExpectSamePose(*a.T_map_session, *b.T_map_session);
  EXPECT_EQ(a.scale_map_session, b.scale_map_session);
  EXPECT_EQ(a.aligned_at_keyframe, b.aligned_at_keyframe);
  EXPECT_EQ(a.optimized.has_value(), b.optimized.has_value());
  EXPECT_EQ(a.num_keyframes, b.num_keyframes);
  ASSERT_EQ(a.quarantine.has_value(), b.quarantine.has_value());
  if (!a.quarantine) return;
  EXPECT_EQ(a.quarantine->since_ns, b.quarantine->since_ns);
  EXPECT_EQ(a.quarantine->reason, b.quarantine->reason);
  EXPECT_EQ(a.quarantine->released_ns, b.quarantine->released_ns);
}

void ExpectSameCamera(const Camera& a, const Camera& b) {
  EXPECT_EQ(ModelName(a.projection), ModelName(b.projection));
  EXPECT_EQ(Coefficients(a.projection), Coefficients(b.projection));
  EXPECT_EQ(a.width_px, b.width_px);
  EXPECT_EQ(a.height_px, b.height_px);
  EXPECT_EQ(a.stereo_baseline_m, b.stereo_baseline_m);
}

std::vector<PointRecord> PointsOf(MapReader& reader, SessionId session) {
  std::vector<PointRecord> points = Value(reader.PointsOfSession(session));
  std::ranges::sort(points, {}, &PointRecord::id);
  return points;
}

void ExpectSamePoint(const PointRecord& a, const PointRecord& b, const SameIds& same) {
  EXPECT_EQ(a.session_point, b.session_point);
  EXPECT_EQ(a.in_map, b.in_map);
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.view_direction, b.view_direction);
  EXPECT_EQ(a.descriptor, b.descriptor);
  EXPECT_EQ(a.reference_distance_m, b.reference_distance_m);
  EXPECT_EQ(a.num_observations, b.num_observations);
  EXPECT_EQ(a.confidence, b.confidence);
  std::vector<FrameId> observers;
  for (const FrameId frame : a.observers) {
    // Counters are always those of today: AS OF an earlier revision they name frames that were not there yet.
    if (const auto found = same.frames.find(frame); found != same.frames.end()) observers.push_back(found->second);
  }
  EXPECT_EQ(observers, b.observers);
}

void ExpectSamePacket(const std::string& a, const std::string& b, const SameIds& same) {
  const Keyframe before = Value(DecodeKeyframe(a));
  const auto renumber = [&](uint64_t point) {
    const auto found = same.points.find(MapPointId(point));
    return found == same.points.end() ? 0 : found->second.value();
  };
  EXPECT_EQ(RenumberKeyframe(a, same.sessions.at(before.session), renumber), b);
}

void ExpectSameFrame(MapReader& reader_a, const FrameRecord& a, MapReader& reader_b, const FrameRecord& b,
                     const SameIds& same) {
  EXPECT_EQ(same.sessions.at(a.session), b.session);
  EXPECT_EQ(a.number, b.number);
  EXPECT_EQ(a.stamp_ns, b.stamp_ns);
  EXPECT_EQ(a.in_map, b.in_map);
  ExpectSamePose(a.T_frame_camera, b.T_frame_camera);
  EXPECT_EQ(a.partial, b.partial);
  EXPECT_EQ(a.overlap, b.overlap);
  EXPECT_EQ(a.num_features, b.num_features);
  ExpectSamePacket(Value(reader_a.GetPacket(a.id)), Value(reader_b.GetPacket(b.id)), same);
  std::vector<Observation> seen_a = Value(reader_a.GetObservations(a.id));
  // A frame may name points that have been retired since.
  std::erase_if(seen_a, [&](const Observation& seen) { return !same.points.contains(seen.point); });
  const std::vector<Observation> seen_b = Value(reader_b.GetObservations(b.id));
  ASSERT_EQ(seen_a.size(), seen_b.size());
  for (size_t i = 0; i < seen_a.size(); ++i) {
    EXPECT_EQ(seen_a[i].feature_idx, seen_b[i].feature_idx);
    EXPECT_EQ(same.points.at(seen_a[i].point), seen_b[i].point);
    EXPECT_EQ(seen_a[i].depth_m, seen_b[i].depth_m);
  }
}

/// What each number in the frame's packet stands for.
void ExpectSameSessionPoints(MapReader& a, const FrameRecord& frame, MapReader& b, const SameIds& same) {
  std::vector<uint64_t> numbers;
  const Keyframe keyframe = Value(DecodeKeyframe(Value(a.GetPacket(frame.id))));
  for (const KeyframeFeature& feature : keyframe.features) {
    if (feature.point && feature.point->kind == PointReference::Kind::kSessionPoint) {
      numbers.push_back(feature.point->id);
    }
  }
  const auto found_a = Value(a.FindSessionPoints(frame.session, numbers));
  const auto found_b = Value(b.FindSessionPoints(same.sessions.at(frame.session), numbers));
  for (size_t i = 0; i < numbers.size(); ++i) {
    ASSERT_EQ(found_a[i].has_value(), found_b[i].has_value()) << numbers[i];
    if (found_a[i]) {
      EXPECT_EQ(same.points.at(*found_a[i]), *found_b[i]) << numbers[i];
    }
  }
}

void ExpectSameTiles(MapReader& a, MapId map_a, MapReader& b, MapId map_b, const SameIds& same) {
  const std::vector<TileRecord> tiles_a = Value(a.ListTiles(map_a, std::nullopt));
  const std::vector<TileRecord> tiles_b = Value(b.ListTiles(map_b, std::nullopt));
  ASSERT_EQ(tiles_a.size(), tiles_b.size());
  for (size_t i = 0; i < tiles_a.size(); ++i) {
    EXPECT_EQ(tiles_a[i].key, tiles_b[i].key);
    EXPECT_EQ(tiles_a[i].num_points, tiles_b[i].num_points);
    std::set<MapPointId> in_a, in_b;
    for (const PointRecord& point : Value(a.PointsInTile(map_a, tiles_a[i].key))) in_a.insert(same.points.at(point.id));
    for (const PointRecord& point : Value(b.PointsInTile(map_b, tiles_b[i].key))) in_b.insert(point.id);
    EXPECT_EQ(in_a, in_b);
  }
}

void ExpectSameRecord(const MapRecord& a, const MapRecord& b, const SameIds& same) {
  EXPECT_EQ(a.created_ns, b.created_ns);
  EXPECT_EQ(a.tile_edge_m, b.tile_edge_m);
  EXPECT_EQ(a.cone_range_m, b.cone_range_m);
  ASSERT_EQ(a.founder.has_value(), b.founder.has_value());
  if (a.founder) {
    EXPECT_EQ(same.sessions.at(*a.founder), *b.founder);
  }
  EXPECT_EQ(a.has_metric_scale, b.has_metric_scale);
  EXPECT_EQ(a.num_frames, b.num_frames);
  EXPECT_EQ(a.num_points, b.num_points);
  EXPECT_EQ(a.num_sessions, b.num_sessions);
  EXPECT_FALSE(FirstDifference(a.features, b.features));
}

}  // namespace

std::string ExportToString(MapStore& store, const std::string& name, const std::string& at) {
  std::string bundle;
  const auto reader = Value(ReadMapAt(store, name, at));
  const auto append = [&bundle](std::string_view bytes) {
    bundle += bytes;
    return absl::OkStatus();
  };
  Check(ExportBundle({}, *reader, Value(reader->FindMap(name)), kExportedNs, append, {}));
  return bundle;
}

StatusOr<ImportedMap> ImportFromString(MapStore& store, const std::string& bundle, const std::string& name,
                                       const CallContext& context, const BundleImportObserver& on_progress) {
  MAPP_ASSIGN_OR_RETURN(BundleFile file, BundleFile::CreateUnnamed(std::filesystem::temp_directory_path().string()));
  MAPP_RETURN_IF_ERROR(file.Append(bundle));
  return ImportBundle(context, store, file, name, on_progress);
}

ByteSource SourceOf(const std::string& bytes) {
  return [&bytes, position = size_t{0}](char* to, size_t size) mutable -> StatusOr<size_t> {
    const size_t count = std::min(size, bytes.size() - position);
    std::memcpy(to, bytes.data() + position, count);
    position += count;
    return count;
  };
}

StatusOr<std::vector<BundleRecord>> ReadRecords(const std::string& bundle) {
  MAPP_ASSIGN_OR_RETURN(BundleReader reader, BundleReader::Open(SourceOf(bundle)));
  std::vector<BundleRecord> records;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(std::optional<BundleRecord> record, reader.Next());
    if (!record) return records;
    records.push_back(*std::move(record));
  }
}

std::string WriteRecords(const std::vector<BundleRecord>& records) {
  std::string bundle;
  BundleWriter writer([&bundle](std::string_view bytes) {
    bundle += bytes;
    return absl::OkStatus();
  });
  for (const BundleRecord& record : records) Check(writer.Add(record));
  Check(writer.Finish());
  return bundle;
}

void ExpectSameMap(MapReader& a, const MapRecord& map_a, MapReader& b, const MapRecord& map_b) {
  SameIds same;
  const std::vector<SessionRecord> sessions_a = Value(a.ListSessions(map_a.id));
  const std::vector<SessionRecord> sessions_b = Value(b.ListSessions(map_b.id));
  ASSERT_EQ(sessions_a.size(), sessions_b.size());
  const std::vector<FrameRecord> frames_a = Value(a.ListFrames(map_a.id, std::nullopt));
  const std::vector<FrameRecord> frames_b = Value(b.ListFrames(map_b.id, std::nullopt));
  ASSERT_EQ(frames_a.size(), frames_b.size());
  for (size_t i = 0; i < frames_a.size(); ++i) same.frames[frames_a[i].id] = frames_b[i].id;
  for (size_t i = 0; i < sessions_a.size(); ++i) {
    same.sessions[sessions_a[i].id] = sessions_b[i].id;
    ExpectSameSession(sessions_a[i], sessions_b[i]);
    ExpectSameCamera(Value(a.GetCamera(sessions_a[i].camera)).camera, Value(b.GetCamera(sessions_b[i].camera)).camera);
    const std::vector<PointRecord> points_a = PointsOf(a, sessions_a[i].id);
    const std::vector<PointRecord> points_b = PointsOf(b, sessions_b[i].id);
    ASSERT_EQ(points_a.size(), points_b.size());
    for (size_t j = 0; j < points_a.size(); ++j) {
      same.points[points_a[j].id] = points_b[j].id;
      ExpectSamePoint(points_a[j], points_b[j], same);
    }
  }
  ExpectSameRecord(map_a, map_b, same);
  for (size_t i = 0; i < frames_a.size(); ++i) {
    ExpectSameFrame(a, frames_a[i], b, frames_b[i], same);
    ExpectSameSessionPoints(a, frames_a[i], b, same);
  }
  ExpectSameTiles(a, map_a.id, b, map_b.id, same);
}

SmallMap::SmallMap() : store_(Value(OpenMemoryMapStore(CreateMemoryDatabase()))) {
  Check(store_->Write({}, [](MapWriter& writer) -> Status {
    const Scene scene = AddScene(writer, "cell");
    SessionRecord session = Value(writer.GetSession(scene.session));
    session.T_map_session = PoseAt(0, 0, 0);
    session.closed_ns = session.opened_ns + 1;
    Check(writer.UpdateSession(session));
    Check(writer.SetFounder(scene.map, scene.session));
    std::vector<MapPointId> points;
    for (uint64_t number = 1; number <= 4; ++number) {
      PointRecord point = TestPoint(scene.session, number, {0.1 * static_cast<double>(number), 0.2, 3});
      point.observers.clear();
      points.push_back(Value(writer.InsertPoint(scene.map, point)));
    }
    Keyframe keyframe;
    keyframe.session = scene.session;
    for (uint64_t number = 1; number <= 4; ++number) {
      KeyframeFeature feature;
      feature.keypoint.u_px = static_cast<float>(10 * number);
      const bool by_server_id = number == 4;
      feature.point =
          PointReference{.kind = by_server_id ? PointReference::Kind::kMapPoint : PointReference::Kind::kSessionPoint,
                         .id = by_server_id ? points[3].value() : number,
                         .depth_m = 3};
      keyframe.features.push_back(feature);
    }
    std::vector<Observation> seen = {{0, points[0], 3}, {1, points[1], 3}, {3, points[3], 0}};
    std::vector<FrameId> frames;
    for (; keyframe.number < 2; ++keyframe.number) {
      FrameRecord frame = TestFrame(scene.map, scene.session, scene.camera, keyframe.number, PoseAt(0.1, 0.2, 0.3));
      frame.stamp_ns = keyframe.stamp_ns;
      frame.partial = keyframe.partial;
      frame.overlap = keyframe.overlap;
      frame.num_features = 4;
      frames.push_back(Value(writer.InsertFrame(frame, EncodeKeyframe(keyframe), seen)));
    }
    PointRecord touched = Value(writer.GetPoints({points.data(), 1})).front();
    touched.observers = frames;
    Check(writer.TouchPoint(touched));
    return writer.RetirePoint(points[2], points[0]);
  }));
  bundle_ = ExportToString(*store_, "cell");
}

}  // namespace mapp::testing
