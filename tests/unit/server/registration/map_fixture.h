#pragma once

#include "mapp/map/keyframe.h"
#include "server/service/session_events.h"
#include "server/service/tile_cache.h"
#include "storage/map_store.h"

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp::testing {

/// A map database on disk for one test, with what stands around registrar and optimizer in the service.
class MapFixture {
 public:
  MapFixture();
  ~MapFixture();
  MapFixture(const MapFixture&) = delete;
  MapFixture& operator=(const MapFixture&) = delete;

  MapStore& store() { return *store_; }
  TileCache& tiles() { return *tiles_; }
  SessionEvents& events() { return events_; }
  MapId map() const { return map_; }

  /// A founder's frame is the map's, a unit of its own being `scale` of the map's; any other session begins as a
  /// fragment.
  SessionId OpenSession(const Camera& camera, bool founder, SensorKind sensor = SensorKind::kRgbd, double scale = 1);
  /// Stores the keyframe as an upload would: new points from their depth, known ones by the session's number for them.
  FrameId Store(SessionId session, const Keyframe& keyframe);
  void CloseSession(SessionId session);

  std::unique_ptr<MapReader> Read();
  SessionRecord Session(SessionId session);
  std::vector<FrameRecord> Frames(SessionId session);

 private:
  std::string folder_;
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<TileCache> tiles_;
  SessionEvents events_;
  MapId map_;
};

/// Keeps what is published to one session, and waits for it.
class EventLog {
 public:
  EventLog(MapFixture& fixture, SessionId session);

  /// The event of this kind that came as number `index` (from 0); nullopt after half a minute without it.
  template <typename Event>
  std::optional<Event> WaitFor(size_t index) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    const MutexLock lock(mutex_);
    for (;;) {
      size_t seen = 0;
      for (const SessionEvent& event : events_) {
        if (std::holds_alternative<Event>(event) && seen++ == index) return std::get<Event>(event);
      }
      if (!changed_.WaitUntil(mutex_, deadline)) return std::nullopt;
    }
  }
  template <typename Event>
  size_t Count() {
    const MutexLock lock(mutex_);
    size_t count = 0;
    for (const SessionEvent& event : events_) count += std::holds_alternative<Event>(event) ? 1 : 0;
    return count;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  std::vector<SessionEvent> events_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<SessionEvents::Subscription> subscription_;
};

}  // namespace mapp::testing
