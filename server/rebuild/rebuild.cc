#include "server/rebuild/rebuild.h"

#include "mapp/base/mutex.h"
#include "server/rebuild/log_events.h"
#include "server/service/map_service.h"
#include "server/service/median.h"
#include "server/service/replay_guide.h"
#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "storage/sqlite/staged_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

constexpr size_t kMaxProblems = 100;

/// What the log's database says of its sessions and points, for the integration of their keyframes.
class Original {
 public:
  static StatusOr<std::unique_ptr<Original>> Load(MapReader& reader) {
    std::unique_ptr<Original> original(new Original(reader));
    MAPP_ASSIGN_OR_RETURN(original->maps_, reader.ListMaps());
    MAPP_ASSIGN_OR_RETURN(original->sessions_, reader.ListSessions(std::nullopt));
    for (const MapRecord& map : original->maps_) MAPP_RETURN_IF_ERROR(original->LoadMap(map));
    return original;
  }

  const std::vector<MapRecord>& maps() const { return maps_; }
  const std::vector<SessionRecord>& sessions() const { return sessions_; }
  const std::vector<SessionId>& reverted() const { return reverted_; }
  /// Of frames in the map.
  const std::map<FrameId, Eigen::Vector3d>& centers(MapId map) const { return centers_.at(map); }

  /// What stood in the map does so again; so does what was reverted, until all is there; fragments may find their
  /// place.
  bool Admits(SessionId session, uint32_t number) const {
    const auto kept_out = left_out_.find(session);
    return kept_out == left_out_.end() || !kept_out->second.contains(number);
  }

  Status Translate(MapReader& rebuilt, Keyframe& keyframe) {
    for (KeyframeFeature& feature : keyframe.features) {
      if (!feature.point || feature.point->kind != PointReference::Kind::kMapPoint) continue;
      const auto founder = founders_.find(MapPointId(feature.point->id));
      std::optional<MapPointId> point;
      if (founder != founders_.end()) {
        MAPP_ASSIGN_OR_RETURN(const auto found,
                              rebuilt.FindSessionPoints(founder->second.first, std::span(&founder->second.second, 1)));
        point = found.front();
      }
      // No point has the id 0: what this feature shows is found by its looks, or not.
      feature.point->id = point ? point->value() : 0;
    }
    return absl::OkStatus();
  }

 private:
  explicit Original(MapReader& reader) : reader_(reader) {}

  Status LoadMap(const MapRecord& map) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<RevisionRecord> revisions,
                          reader_.ListRevisions(map.id, Revision(0), map.revision));
    std::set<SessionId> reverted;
    for (const RevisionRecord& revision : revisions) {
      if (revision.cause == RevisionCause::kReversion && revision.session) reverted.insert(*revision.session);
    }
    std::map<FrameId, Eigen::Vector3d>& centers = centers_[map.id];
    for (const SessionRecord& session : sessions_) {
      if (session.map != map.id) continue;
      MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader_.ListFrames(map.id, session.id));
      for (const FrameRecord& frame : frames) {
        if (frame.in_map) centers.emplace(frame.id, frame.T_frame_camera.translation());
      }
      const bool is_reverted = session.IsQuarantined() && reverted.contains(session.id);
      if (is_reverted) reverted_.push_back(session.id);
      if ((session.T_map_session || session.IsQuarantined()) && !is_reverted) {
        for (const FrameRecord& frame : frames) {
          if (!frame.in_map) left_out_[session.id].insert(frame.number);
        }
      }
      MAPP_ASSIGN_OR_RETURN(const std::vector<NumberedPoint> points, reader_.ListNumberedPoints(session.id));
      for (const NumberedPoint& point : points) {
        founders_.emplace(point.point, std::pair(session.id, point.session_point));
      }
    }
    return absl::OkStatus();
  }

  MapReader& reader_;
  std::vector<MapRecord> maps_;
  std::vector<SessionRecord> sessions_;
  std::vector<SessionId> reverted_;
  std::map<MapId, std::map<FrameId, Eigen::Vector3d>> centers_;
  std::unordered_map<SessionId, std::set<uint32_t>> left_out_;  ///< keyframes that never were in the map, or no more
  std::unordered_map<MapPointId, std::pair<SessionId, uint64_t>> founders_;
};

class Rebuild {
 public:
  Rebuild(const CallContext& context, MapReader& log, const RebuildOptions& options)
      : context_(context), log_(log), options_(options) {}

  StatusOr<RebuildReport> Run(const std::string& file) {
    MAPP_ASSIGN_OR_RETURN(original_, Original::Load(log_));
    MAPP_ASSIGN_OR_RETURN(const std::vector<LogEvent> events, ListLogEvents(log_));
    MAPP_RETURN_IF_ERROR(Open(file));
    MAPP_RETURN_IF_ERROR(Play(events));
    MAPP_RETURN_IF_ERROR(Finish());
    MAPP_RETURN_IF_ERROR(Compare());
    service_.reset();
    MAPP_RETURN_IF_ERROR(store_->Close());
    report_.problems = TakeProblems();
    return std::move(report_);
  }

 private:
  Status Open(const std::string& file);
  Status Play(const std::vector<LogEvent>& events);
  Status OpenSession(SessionId session);
  Status Upload(FrameId frame);
  Status Finish();
  Status Compare();
  void AddProblem(std::string problem);
  std::vector<std::string> TakeProblems();

  const CallContext& context_;
  MapReader& log_;
  const RebuildOptions& options_;
  std::unique_ptr<Original> original_;
  std::atomic<int64_t> now_ns_ = 0;
  ReplayGuide guide_;
  Mutex mutex_;
  std::vector<std::string> problems_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<MapService> service_;
  std::map<CameraId, CameraId> cameras_;
  RebuildReport report_;
};

void Rebuild::AddProblem(std::string problem) {
  const MutexLock lock(mutex_);
  if (problems_.size() < kMaxProblems) problems_.push_back(std::move(problem));
}

std::vector<std::string> Rebuild::TakeProblems() {
  const MutexLock lock(mutex_);
  return std::exchange(problems_, {});
}

Status Rebuild::Open(const std::string& file) {
  // Until it is renamed nobody counts on it: it is synced once, when it is whole.
  SqliteOptions store_options{.sync_commits = false};
  store_options.unix_now_ns = [this] { return now_ns_.load(); };
  MAPP_ASSIGN_OR_RETURN(store_, OpenSqliteMapStore(file, store_options));
  for (const MapRecord& map : original_->maps()) {
    now_ns_ = map.created_ns;
    const auto create = [&map](MapWriter& writer) -> Status {
      MAPP_RETURN_IF_ERROR(writer.SkipIds(map.id, {}, {}));
      return writer.CreateMap(map).status();
    };
    MAPP_RETURN_IF_ERROR(store_->Write(context_, create));
  }
  guide_.admits = [this](SessionId session, uint32_t number) { return original_->Admits(session, number); };
  guide_.translate = [this](MapReader& reader, Keyframe& keyframe) { return original_->Translate(reader, keyframe); };
  const auto note = [this](SessionId session, const Status& status) {
    AddProblem(fmt::format("session {}: {}", session.value(), status.ToString()));
  };
  MapServiceOptions service_options;
  service_options.registrar.on_error = note;
  service_options.optimizer.on_error = note;
  service_options.optimizer.num_threads = options_.num_threads;
  // How fast this machine is must not show in the map.
  service_options.optimizer.max_seconds = std::numeric_limits<double>::max();
  service_options.optimizer.max_map_seconds = std::numeric_limits<double>::max();
  service_options.max_keyframe_bytes = std::numeric_limits<size_t>::max();
  service_options.replay = &guide_;
  MAPP_ASSIGN_OR_RETURN(service_, MapService::Create(*store_, service_options));
  return absl::OkStatus();
}

Status Rebuild::Play(const std::vector<LogEvent>& events) {
  RebuildProgress progress;
  progress.num_keyframes = std::ranges::count(events, LogEvent::Kind::kKeyframe, &LogEvent::kind);
  for (const LogEvent& event : events) {
    MAPP_RETURN_IF_ERROR(context_.Check());
    now_ns_ = event.time_ns;
    switch (event.kind) {
      case LogEvent::Kind::kOpened:
        MAPP_RETURN_IF_ERROR(OpenSession(event.session));
        break;
      case LogEvent::Kind::kKeyframe:
        MAPP_RETURN_IF_ERROR(Annotate(Upload(event.frame), fmt::format("frame {}", event.frame.value())));
        ++progress.num_done;
        if (options_.on_progress) options_.on_progress(progress);
        break;
      case LogEvent::Kind::kMapOptimized: {
        MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_->Read());
        MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->GetMap(event.map));
        MAPP_RETURN_IF_ERROR(service_->OptimizeMap(context_, map.name, {}).status());
        break;
      }
      case LogEvent::Kind::kClosed:
        MAPP_RETURN_IF_ERROR(service_->CloseSession(context_, event.session).status());
        break;
    }
    service_->WaitUntilIdle();
  }
  return absl::OkStatus();
}

Status Rebuild::OpenSession(SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord record, log_.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(const CameraRecord camera, log_.GetCamera(record.camera));
  return store_->Write(context_, [&](MapWriter& writer) -> Status {
    MAPP_RETURN_IF_ERROR(writer.SkipIds({}, session, {}));
    SessionRecord opened;
    opened.map = record.map;
    opened.device = record.device;
    opened.sensor = record.sensor;
    if (!cameras_.contains(record.camera)) {
      MAPP_ASSIGN_OR_RETURN(cameras_[record.camera], writer.InsertCamera(camera.camera));
    }
    opened.camera = cameras_.at(record.camera);
    return writer.InsertSession(opened).status();
  });
}

Status Rebuild::Upload(FrameId frame) {
  const StatusOr<std::string> packet = log_.GetPacket(frame);
  if (absl::IsDataLoss(packet.status())) {
    AddProblem(packet.status().ToString());
    return absl::OkStatus();
  }
  MAPP_RETURN_IF_ERROR(packet.status());
  MAPP_RETURN_IF_ERROR(store_->Write(context_, [frame](MapWriter& writer) { return writer.SkipIds({}, {}, frame); }));
  MAPP_ASSIGN_OR_RETURN(const UploadResult result, service_->UploadKeyframe(context_, *packet));
  if (result.frame != frame) {
    return absl::DataLossError(fmt::format("its packet is that of frame {}", result.frame.value()));
  }
  ++report_.num_keyframes;
  return absl::OkStatus();
}

/// What operators and the judge have said of sessions since.
Status Rebuild::Finish() {
  for (const SessionId session : original_->reverted()) {
    MAPP_RETURN_IF_ERROR(service_->RevertSession(context_, session, "", /*dry_run=*/false).status());
    service_->WaitUntilIdle();
  }
  return store_->Write(context_, [&](MapWriter& writer) -> Status {
    for (const SessionRecord& original : original_->sessions()) {
      MAPP_ASSIGN_OR_RETURN(SessionRecord session, writer.GetSession(original.id));
      session.closed_ns = original.closed_ns;
      session.quarantine = original.quarantine;
      MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
    }
    return absl::OkStatus();
  });
}

Status Rebuild::Compare() {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_->Read());
  for (const MapRecord& before : original_->maps()) {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->GetMap(before.id));
    RebuiltMap& rebuilt = report_.maps.emplace_back();
    rebuilt.name = map.name;
    rebuilt.num_frames_before = before.num_frames;
    rebuilt.num_frames = map.num_frames;
    rebuilt.num_points_before = before.num_points;
    rebuilt.num_points = map.num_points;
    MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, log_.ListTags(before.id));
    for (const TagRecord& tag : tags) rebuilt.dropped_tags.push_back(tag.name);
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader->ListFrames(map.id, std::nullopt));
    std::vector<double> moved_m;
    for (const FrameRecord& frame : frames) {
      const auto center = original_->centers(map.id).find(frame.id);
      if (!frame.in_map || center == original_->centers(map.id).end()) continue;
      moved_m.push_back((frame.T_frame_camera.translation() - center->second).norm());
    }
    if (moved_m.empty()) continue;
    rebuilt.max_moved_m = *std::ranges::max_element(moved_m);
    rebuilt.median_moved_m = Median(std::move(moved_m));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<RebuildReport> RebuildDatabase(const CallContext& context, const std::string& from, const std::string& to,
                                        const RebuildOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> log, OpenSqliteMapStore(from, {.read_only = true}));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, log->Read());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<sqlite::StagedFile> staged, sqlite::StagedFile::Create(to));
  StatusOr<RebuildReport> report = Rebuild(context, *reader, options).Run(staged->path());
  // Of the store that wrote it: nobody else opens a file of that name.
  std::error_code ignored;
  std::filesystem::remove(staged->path() + ".lock", ignored);
  MAPP_RETURN_IF_ERROR(report.status());
  MAPP_RETURN_IF_ERROR(staged->TakePermissions(from));
  MAPP_RETURN_IF_ERROR(staged->Commit(sqlite::StagedFile::Existing::kRefuse));
  return report;
}

}  // namespace mapp
