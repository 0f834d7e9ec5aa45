#include "bundle/bundle_check.h"
#include "bundle/id_table.h"
#include "mapp/codec/keyframe_codec.h"
#include "server/service/map_bundle.h"
#include "server/service/map_settings.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <map>

namespace mapp {
namespace {

const size_t kFrames = BundleRecord(BundleFrame()).index();
/// Asking whether the caller is still there costs more than writing a point.
constexpr uint64_t kRecordsBetweenLooks = 256;

/// Writes a bundle's records, which have been checked, under numbers of the store's own.
class BundleImport {
 public:
  BundleImport(MapWriter& writer, std::string name) : writer_(writer), name_(std::move(name)) {}

  Status Take(const BundleRecord& record) {
    if (num_sealed_ == 0 && record.index() >= kFrames) num_sealed_ = (points_.Seal(), 1);
    if (num_sealed_ == 1 && record.index() > kFrames) num_sealed_ = (frames_.Seal(), 2);
    return std::visit([this](const auto& it) { return Write(it); }, record);
  }

  StatusOr<ImportedMap> Finish() {
    MAPP_ASSIGN_OR_RETURN(imported_.map, writer_.GetMap(map_));
    return std::move(imported_);
  }

 private:
  Status Write(const BundleMap& record) {
    MapRecord map = record.map;
    map.name = name_;
    MAPP_ASSIGN_OR_RETURN(map_, writer_.CreateMap(map));
    MAPP_ASSIGN_OR_RETURN(revision_, writer_.NextRevision(map_));
    MAPP_RETURN_IF_ERROR(writer_.SetCause(map_, RevisionCause::kImport, std::nullopt));
    founder_ = map.founder;
    return map.has_metric_scale ? absl::OkStatus() : writer_.SetMetricScale(map_, false);
  }

  Status Write(const CameraRecord& record) {
    MAPP_ASSIGN_OR_RETURN(cameras_[record.id], writer_.InsertCamera(record.camera));
    return absl::OkStatus();
  }

  Status Write(const SessionRecord& record) {
    MAPP_RETURN_IF_ERROR(ValidateName(record.device, "device"));
    SessionRecord session = record;
    session.map = map_;
    session.camera = cameras_.at(record.camera);
    if (session.optimized) session.optimized = revision_;
    MAPP_ASSIGN_OR_RETURN(session.id, writer_.InsertSession(session));
    if (session.T_map_session && !session.optimized) imported_.owed.push_back(session.id);
    sessions_[record.id] = {session.id, session.camera};
    return founder_ == record.id ? writer_.SetFounder(map_, session.id) : absl::OkStatus();
  }

  Status Write(const PointRecord& record) {
    PointRecord point = record;
    point.session = sessions_.at(record.session).id;
    MAPP_ASSIGN_OR_RETURN(const MapPointId id, writer_.InsertPoint(map_, point));
    points_.Add(record.id.value(), id.value());
    return absl::OkStatus();
  }

  Status Write(const BundleFrame& record) {
    MAPP_ASSIGN_OR_RETURN(const Keyframe keyframe, DecodeKeyframe(record.packet));
    const ImportedSession& session = sessions_.at(keyframe.session);
    FrameRecord frame;
    frame.map = map_;
    frame.session = session.id;
    frame.camera = session.camera;
    frame.number = keyframe.number;
    frame.stamp_ns = keyframe.stamp_ns;
    frame.in_map = record.in_map;
    frame.T_frame_camera = record.T_frame_camera;
    frame.partial = keyframe.partial;
    frame.overlap = keyframe.overlap;
    frame.num_features = static_cast<uint32_t>(keyframe.features.size());
    std::vector<Observation> observations = record.observations;
    for (Observation& seen : observations) seen.point = NewId(seen.point);
    const std::string packet =
        RenumberKeyframe(record.packet, session.id, [this](uint64_t point) { return points_.Find(point).value_or(0); });
    MAPP_ASSIGN_OR_RETURN(const FrameId id, writer_.InsertFrame(frame, packet, observations));
    frames_.Add(record.id.value(), id.value());
    return absl::OkStatus();
  }

  Status Write(const PointObservers& record) {
    MAPP_ASSIGN_OR_RETURN(PointRecord point, GetPoint(record.point));
    for (const FrameId frame : record.frames) point.observers.emplace_back(*frames_.Find(frame.value()));
    return writer_.TouchPoint(point);
  }

  /// A point for the number that has ended as soon as it was made: FindSessionPoints goes on from there.
  Status Write(const FusedPoint& record) {
    MAPP_ASSIGN_OR_RETURN(PointRecord point, GetPoint(record.point));
    const MapPointId stands_for_it = point.id;
    point.session = sessions_.at(record.session).id;
    point.session_point = record.session_point;
    MAPP_ASSIGN_OR_RETURN(const MapPointId fused, writer_.InsertPoint(map_, point));
    return writer_.RetirePoint(fused, stands_for_it);
  }

  Status Write(const BundleTag& record) { return writer_.PutTag(map_, record.name, revision_); }

  MapPointId NewId(MapPointId point) const { return MapPointId(*points_.Find(point.value())); }

  StatusOr<PointRecord> GetPoint(MapPointId old_id) {
    const MapPointId id = NewId(old_id);
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer_.GetPoints({&id, 1}));
    return points.front();
  }

  struct ImportedSession {
    SessionId id;
    CameraId camera;
  };

  MapWriter& writer_;
  const std::string name_;
  ImportedMap imported_;
  MapId map_;
  Revision revision_;
  std::optional<SessionId> founder_;
  std::map<CameraId, CameraId> cameras_;
  std::map<SessionId, ImportedSession> sessions_;
  IdTable points_, frames_;
  int num_sealed_ = 0;  ///< of these two
};

Status WriteAll(const CallContext& context, ByteSource source, BundleImport& import,
                const std::function<void(uint64_t bytes_done)>& on_progress) {
  MAPP_ASSIGN_OR_RETURN(BundleReader reader, BundleReader::Open(std::move(source)));
  for (uint64_t i = 0;; ++i) {
    if (i % kRecordsBetweenLooks == 0) MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(const std::optional<BundleRecord> record, reader.Next());
    if (!record) return absl::OkStatus();
    MAPP_RETURN_IF_ERROR(import.Take(*record));
    on_progress(reader.num_bytes());
  }
}

}  // namespace

Status CheckNameIsFree(MapReader& reader, const std::string& name) {
  const StatusOr<MapRecord> taken = reader.FindMap(name);
  if (!taken.ok()) return absl::IsNotFound(taken.status()) ? absl::OkStatus() : taken.status();
  return absl::AlreadyExistsError(
      fmt::format("map \"{}\" is there already: import the bundle under another name with --as", name));
}

StatusOr<ImportedMap> ImportBundle(const CallContext& context, MapStore& store, BundleFile& bundle,
                                   const std::string& name, const BundleImportObserver& on_progress) {
  const auto tell = [&](bool writing) {
    return [&, writing](uint64_t bytes_done) {
      if (on_progress) on_progress({writing, bytes_done, bundle.num_bytes()});
    };
  };
  MAPP_ASSIGN_OR_RETURN(ByteSource to_check, bundle.Read());
  MAPP_ASSIGN_OR_RETURN(const BundleSummary summary, CheckBundle(context, std::move(to_check), tell(false)));
  const std::string& new_name = name.empty() ? summary.map.map.name : name;
  MAPP_RETURN_IF_ERROR(ValidateName(new_name, "name"));
  MAPP_RETURN_IF_ERROR(CheckScaleIsComputedWith(summary.map.map.features));
  ImportedMap imported;
  const Status written = store.Write(context, [&](MapWriter& writer) -> Status {
    MAPP_RETURN_IF_ERROR(CheckNameIsFree(writer, new_name));
    MAPP_ASSIGN_OR_RETURN(ByteSource to_write, bundle.Read());
    BundleImport import(writer, new_name);
    MAPP_RETURN_IF_ERROR(WriteAll(context, std::move(to_write), import, tell(true)));
    MAPP_ASSIGN_OR_RETURN(imported, import.Finish());
    return absl::OkStatus();
  });
  MAPP_RETURN_IF_ERROR(written);
  imported.counts = summary.counts;
  return imported;
}

}  // namespace mapp
