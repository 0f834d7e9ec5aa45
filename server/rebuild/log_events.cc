#include "server/rebuild/log_events.h"

#include "storage/map_store.h"

#include <algorithm>
#include <limits>
#include <tuple>
#include <unordered_map>

namespace mapp {
namespace {

constexpr int64_t kNever = std::numeric_limits<int64_t>::max();

struct Span {
  int64_t first_ns = kNever, last_ns = 0;  ///< of a session's keyframes
};

class EventList {
 public:
  explicit EventList(MapReader& reader) : reader_(reader) {}

  StatusOr<std::vector<LogEvent>> Run() {
    MAPP_ASSIGN_OR_RETURN(const std::vector<MapRecord> maps, reader_.ListMaps());
    for (const MapRecord& map : maps) MAPP_RETURN_IF_ERROR(AddMap(map));
    OrderKeyframes();
    MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, reader_.ListSessions(std::nullopt));
    AddSessions(sessions);
    std::ranges::sort(events_, {}, [](const LogEvent& event) {
      return std::tuple(event.time_ns, event.kind, event.session.value(), event.frame.value());
    });
    return std::move(events_);
  }

 private:
  Status AddMap(const MapRecord& map) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<RevisionRecord> revisions,
                          reader_.ListRevisions(map.id, Revision(0), map.revision));
    std::unordered_map<uint64_t, int64_t> time_ns;
    bool is_optimizing = false;
    for (const RevisionRecord& revision : revisions) {
      time_ns[revision.revision.value()] = revision.committed_ns;
      // One command makes several: it adjusts and fuses in turns.
      const bool is_whole_map = revision.cause == RevisionCause::kOptimization && !revision.session;
      if (is_whole_map && !is_optimizing) {
        events_.push_back({revision.committed_ns, LogEvent::Kind::kMapOptimized, map.id, {}, {}});
      }
      is_optimizing = is_whole_map || (is_optimizing && revision.cause == RevisionCause::kFusion);
    }
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader_.ListFrames(map.id, std::nullopt));
    for (const FrameRecord& frame : frames) {
      keyframes_.push_back(
          {time_ns[frame.created.value()], LogEvent::Kind::kKeyframe, map.id, frame.session, frame.id});
    }
    return absl::OkStatus();
  }

  void OrderKeyframes() {
    std::ranges::sort(keyframes_, {}, &LogEvent::frame);
    int64_t latest_ns = 0;
    for (LogEvent& event : keyframes_) {
      latest_ns = event.time_ns = std::max(event.time_ns, latest_ns);
      Span& span = spans_[event.session];
      span.first_ns = std::min(span.first_ns, event.time_ns);
      span.last_ns = std::max(span.last_ns, event.time_ns);
    }
    events_.insert(events_.end(), keyframes_.begin(), keyframes_.end());
  }

  void AddSessions(const std::vector<SessionRecord>& sessions) {
    int64_t next_opened_ns = kNever;
    for (auto session = sessions.rbegin(); session != sessions.rend(); ++session) {
      const Span span = spans_[session->id];
      next_opened_ns = std::min({next_opened_ns, session->opened_ns, span.first_ns});
      events_.push_back({next_opened_ns, LogEvent::Kind::kOpened, session->map, session->id, {}});
      if (!session->closed_ns) continue;
      const int64_t closed_ns = std::max({*session->closed_ns, span.last_ns, next_opened_ns});
      events_.push_back({closed_ns, LogEvent::Kind::kClosed, session->map, session->id, {}});
    }
  }

  MapReader& reader_;
  std::vector<LogEvent> events_;
  std::vector<LogEvent> keyframes_;
  std::unordered_map<SessionId, Span> spans_;
};

}  // namespace

StatusOr<std::vector<LogEvent>> ListLogEvents(MapReader& reader) { return EventList(reader).Run(); }

}  // namespace mapp
