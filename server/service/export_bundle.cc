#include "bundle/id_table.h"
#include "mapp/codec/keyframe_codec.h"
#include "server/service/map_bundle.h"
#include "storage/map_store.h"

#include <algorithm>
#include <map>
#include <set>

namespace mapp {
namespace {

constexpr size_t kNumbersAtATime = 1000;

/// The numbers that a session's packets name points by, each once in the end.
class NumberSet {
 public:
  void Add(uint64_t number) {
    numbers_.push_back(number);
    // Each number comes in many packets: without this they would take many times the room.
    if (numbers_.size() >= next_tidy_) {
      Tidy();
      next_tidy_ = std::max<size_t>(2 * numbers_.size(), 4096);
    }
  }
  const std::vector<uint64_t>& Sorted() {
    Tidy();
    return numbers_;
  }

 private:
  void Tidy() {
    std::ranges::sort(numbers_);
    numbers_.erase(std::unique(numbers_.begin(), numbers_.end()), numbers_.end());
  }
  std::vector<uint64_t> numbers_;
  size_t next_tidy_ = 4096;
};

class BundleExport {
 public:
  BundleExport(const CallContext& context, MapReader& reader, MapRecord map, ByteSink sink)
      : context_(context), reader_(reader), map_(std::move(map)), writer_(std::move(sink)) {}

  Status Run(int64_t now_ns, const BundleExportObserver& on_progress) {
    MAPP_RETURN_IF_ERROR(writer_.Add(BundleMap{map_, now_ns}));
    MAPP_ASSIGN_OR_RETURN(sessions_, reader_.ListSessions(map_.id));
    MAPP_RETURN_IF_ERROR(AddCamerasAndSessions(now_ns));
    MAPP_ASSIGN_OR_RETURN(frames_, reader_.ListFrames(map_.id, std::nullopt));
    for (const FrameRecord& frame : frames_) frame_ids_.Add(frame.id.value());
    frame_ids_.Seal();
    for (const SessionRecord& session : sessions_) MAPP_RETURN_IF_ERROR(AddPoints(session.id));
    point_ids_.Seal();
    for (size_t i = 0; i < frames_.size(); ++i) {
      MAPP_RETURN_IF_ERROR(AddFrame(frames_[i]));
      if (on_progress) on_progress(i + 1, frames_.size());
    }
    for (const SessionRecord& session : sessions_) MAPP_RETURN_IF_ERROR(AddObservers(session.id));
    for (const SessionRecord& session : sessions_) MAPP_RETURN_IF_ERROR(AddFused(session.id));
    MAPP_RETURN_IF_ERROR(AddTags());
    return writer_.Finish();
  }

 private:
  Status AddCamerasAndSessions(int64_t now_ns) {
    std::set<CameraId> cameras;
    for (const SessionRecord& session : sessions_) cameras.insert(session.camera);
    for (const CameraId id : cameras) {
      MAPP_ASSIGN_OR_RETURN(const CameraRecord camera, reader_.GetCamera(id));
      MAPP_RETURN_IF_ERROR(writer_.Add(camera));
    }
    for (SessionRecord session : sessions_) {
      if (!session.closed_ns) session.closed_ns = now_ns;
      MAPP_RETURN_IF_ERROR(writer_.Add(session));
    }
    return absl::OkStatus();
  }

  /// By their numbers: of points that a session has made for the same number of its own, the last one counts.
  StatusOr<std::vector<PointRecord>> PointsOf(SessionId session) {
    MAPP_RETURN_IF_ERROR(context_.Check());
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, reader_.PointsOfSession(session));
    std::ranges::sort(points, {}, &PointRecord::id);
    return points;
  }

  Status AddPoints(SessionId session) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, PointsOf(session));
    for (const PointRecord& point : points) {
      point_ids_.Add(point.id.value());
      MAPP_RETURN_IF_ERROR(writer_.Add(point));
    }
    return absl::OkStatus();
  }

  Status AddFrame(const FrameRecord& frame) {
    MAPP_RETURN_IF_ERROR(context_.Check());
    BundleFrame out{.id = frame.id,
                    .in_map = frame.in_map,
                    .T_frame_camera = frame.T_frame_camera,
                    .observations = {},
                    .packet = {}};
    MAPP_ASSIGN_OR_RETURN(out.packet, reader_.GetPacket(frame.id));
    MAPP_ASSIGN_OR_RETURN(out.observations, reader_.GetObservations(frame.id));
    std::erase_if(out.observations,
                  [this](const Observation& seen) { return !point_ids_.Contains(seen.point.value()); });
    StatusOr<Keyframe> keyframe = DecodeKeyframe(out.packet);
    if (!keyframe.ok()) return absl::DataLossError(std::string(keyframe.status().message()));
    NumberSet& numbers = numbers_[frame.session];
    for (const KeyframeFeature& feature : keyframe->features) {
      if (feature.point && feature.point->kind == PointReference::Kind::kSessionPoint) numbers.Add(feature.point->id);
    }
    return writer_.Add(out);
  }

  Status AddObservers(SessionId session) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, PointsOf(session));
    for (const PointRecord& point : points) {
      PointObservers out{point.id, point.observers};
      std::erase_if(out.frames, [this](FrameId frame) { return !frame_ids_.Contains(frame.value()); });
      if (!out.frames.empty()) MAPP_RETURN_IF_ERROR(writer_.Add(out));
    }
    return absl::OkStatus();
  }

  /// Numbers that stand for another point than the one made for them.
  Status AddFused(SessionId session) {
    const std::vector<uint64_t>& numbers = numbers_[session].Sorted();
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, PointsOf(session));
    std::set<std::pair<uint64_t, MapPointId>> own;
    for (const PointRecord& point : points) own.emplace(point.session_point, point.id);
    for (size_t begin = 0; begin < numbers.size(); begin += kNumbersAtATime) {
      const std::span<const uint64_t> some(numbers.data() + begin, std::min(kNumbersAtATime, numbers.size() - begin));
      MAPP_ASSIGN_OR_RETURN(const auto found, reader_.FindSessionPoints(session, some));
      for (size_t i = 0; i < some.size(); ++i) {
        if (!found[i] || own.contains({some[i], *found[i]}) || !point_ids_.Contains(found[i]->value())) continue;
        MAPP_RETURN_IF_ERROR(writer_.Add(FusedPoint{session, some[i], *found[i]}));
      }
    }
    return absl::OkStatus();
  }

  Status AddTags() {
    MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, reader_.ListTags(map_.id));
    for (const TagRecord& tag : tags) {
      if (tag.revision == map_.revision) MAPP_RETURN_IF_ERROR(writer_.Add(BundleTag{tag.name}));
    }
    return absl::OkStatus();
  }

  const CallContext& context_;
  MapReader& reader_;
  const MapRecord map_;
  BundleWriter writer_;
  std::vector<SessionRecord> sessions_;
  std::vector<FrameRecord> frames_;
  IdTable point_ids_;
  IdTable frame_ids_;
  std::map<SessionId, NumberSet> numbers_;
};

}  // namespace

Status ExportBundle(const CallContext& context, MapReader& reader, const MapRecord& map, int64_t now_ns, ByteSink sink,
                    const BundleExportObserver& on_progress) {
  return BundleExport(context, reader, map, std::move(sink)).Run(now_ns, on_progress);
}

}  // namespace mapp
