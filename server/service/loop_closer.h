#pragma once

#include "mapp/base/call_context.h"
#include "server/service/alignment_verifier.h"
#include "server/service/loop.h"
#include "vision/place_index.h"

#include <deque>
#include <map>
#include <optional>
#include <unordered_map>

namespace mapp {

class MapStore;
class SessionEvents;
class TileCache;

/// Loop closure (DESIGN 7): a session in the map that comes back to mapped ground, its own or others', with more drift
/// than association bridges. It is recognised as strictly as a fragment is - geometry, views that do not contradict,
/// several keyframes in agreement - with what it saw just now left out of the map, and corrected over its way
/// (loop_correction.h). Sessions with depth only: those without are put in place as a whole (placement_refiner.h).
/// One thread only; what is kept is in memory, and begins anew after a start.
class LoopCloser {
 public:
  /// All is borrowed.
  LoopCloser(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options)
      : store_(store), tiles_(tiles), events_(events), options_(options) {}

  /// A frame is in the map, new or with the fragment that it came with. Whether a loop was closed: what was said of the
  /// map before it is void then. Errors are the store's, and CANCELLED of `context`.
  StatusOr<bool> OnFrame(const CallContext& context, MapReader& reader, const FrameRecord& frame,
                         const PlaceIndex& index);
  void Forget(SessionId session) { walks_.erase(session); }
  void ForgetAll() { walks_.clear(); }

 private:
  /// One keyframe's word: where the rest of the map has it.
  struct Word {
    KeyframeAlignment alignment;  ///< "session" is the map as it was: its S_map_session is a correction
    LoopMatch match;
  };
  struct Step {
    FrameId frame;
    Pose3 T_map_camera;
    double way_m = 0;  ///< that the session had come; turns count as way
  };
  struct Walk {
    std::map<uint32_t, Step> steps;   ///< by keyframe number
    std::optional<Pose3> last_asked;  ///< T_map_camera of the keyframe asked last
    std::deque<Word> words;
    double silent_until_m = 0;  ///< of its way: it was asked just before
  };

  /// The session's, with this frame on its way.
  StatusOr<Walk*> Follow(MapReader& reader, const FrameRecord& frame);
  /// The keyframe's word, if it has one.
  StatusOr<std::optional<Word>> Ask(MapReader& reader, const FrameView& view, std::span<const FrameId> candidates,
                                    const OwnFrames& stretch, double way_m) const;
  /// Corrects the session when enough words agree on it.
  StatusOr<bool> Decide(const CallContext& context, MapReader& reader, const FrameRecord& frame,
                        const OwnFrames& stretch, Walk& walk);

  MapStore& store_;
  TileCache& tiles_;
  SessionEvents& events_;
  const RegistrarOptions& options_;
  std::unordered_map<SessionId, Walk> walks_;
};

}  // namespace mapp
