#pragma once

#include "server/service/alignment_consensus.h"
#include "vision/place_index.h"

#include <unordered_map>

namespace mapp {

class MapStore;
class SessionEvents;
class TileCache;

/// What the keyframes of a session have said about its place.
struct PlacementWords {
  double map_unit = 1;  ///< UnitOf(the map) at the time: another one makes them void
  AlignmentConsensus consensus;
};

/// Sessions without scale, once they are in a map: the few keyframes that merge one know its scale to some percent, and
/// the way goes on. Further keyframes are asked where the others' map has them, and the session is put where all of
/// them say (session_correction.h) whenever twice as many have told. One thread only; what is kept is in memory, and
/// begins anew after a start.
class PlacementRefiner {
 public:
  /// All is borrowed.
  PlacementRefiner(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options)
      : store_(store), tiles_(tiles), events_(events), options_(options) {}

  /// The session has just merged, by these words.
  void Begin(SessionId session, PlacementWords words);
  /// A frame has joined the map. Errors are the store's.
  Status OnFrame(MapReader& reader, const FrameRecord& frame, const PlaceIndex& index);
  void Forget(SessionId session) { sessions_.erase(session); }
  void ForgetAll() { sessions_.clear(); }

 private:
  struct PlacedSession {
    PlacementWords words;
    size_t num_told = 0;              ///< of the words, when the session was last put where they say
    std::optional<Pose3> last_asked;  ///< T_map_camera of the keyframe asked last
  };

  /// The session's, void words replaced. `map_unit`: the present one.
  PlacedSession& Placed(SessionId session, double map_unit);
  Status Ask(MapReader& reader, const FrameRecord& frame, const SessionRecord& session, const PlaceIndex& index,
             PlacedSession& placed);

  MapStore& store_;
  TileCache& tiles_;
  SessionEvents& events_;
  const RegistrarOptions& options_;
  std::unordered_map<SessionId, PlacedSession> sessions_;
};

}  // namespace mapp
