#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "server/service/overlap_assessor.h"
#include "server/service/service_types.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

namespace mapp {

class MapStore;

/// Share of the map points in the cone that some session but this one has observed, as far as points remember their
/// observers. 0 where there are none.
StatusOr<double> ShareSeenByOthers(TileCache& tiles, MapId map, const ViewCone& cone, SessionId session);

/// What a device asks for, in the map's frame.
struct SharedMapWish {
  MapView view;
  double oversharing = 1.3;  ///< alpha
  LookAhead look_ahead;      ///< `motion` in the map's frame
  std::span<const HeldTile> held_tiles;
  uint64_t max_bytes = 0;
};

/// Sends devices the map around a view (DESIGN 9). Tiles go out as they are stored; one that has changed since it was
/// last stored in its encoded form is encoded, and stored for the next request in a thread of its own. Thread-safe.
class SharedMapSender {
 public:
  explicit SharedMapSender(MapStore& store);
  ~SharedMapSender();

  /// Calls `send` with each encoded tile in the cone {P, h, oversharing * FOV}, nearest first, then with those ahead
  /// (server/service/look_ahead.h); stops with its error. Where the cone holds nothing, nothing is sent.
  /// Each tile is read from a snapshot of its own, so that a slow device pins no snapshot for long.
  /// `max_bytes`: the first tile that would pass it ends the stream; 0 = none.
  StatusOr<SharedMapResult> Send(const CallContext& context, const SharedMapWish& wish,
                                 const std::function<Status(const std::string& tile)>& send);

  /// Ends the thread; what is not stored by then is encoded again when asked for. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
