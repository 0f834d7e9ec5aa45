#pragma once

#include "mapp/base/mutex.h"
#include "server/service/alignment_consensus.h"
#include "server/service/fragment_index.h"
#include "server/service/loop_closer.h"
#include "server/service/placement_refiner.h"
#include "server/service/registrar.h"
#include "server/service/serial_worker.h"
#include "server/service/session_events.h"
#include "server/service/stored_places.h"
#include "server/service/tile_cache.h"
#include "storage/map_store.h"

#include <atomic>
#include <future>
#include <memory>
#include <optional>
#include <set>
#include <unordered_map>
#include <vector>

namespace mapp {

/// Keyframes that may wait. Beyond, a map's index catches up from the store instead.
inline constexpr size_t kMaxWaitingFrames = 4096;

struct Registrar::Impl {
  struct Task {
    enum class Kind { kFrame, kCheckedFrame, kClosed, kMapCame, kMapGone, kQuarantined, kReleased, kAlone };
    Kind kind = Kind::kFrame;
    MapId map;
    SessionId session;
    FrameId frame;                                                 ///< of the first two kinds
    std::vector<FrameId> retired;                                  ///< of kQuarantined
    std::shared_ptr<std::packaged_task<Status()>> work = nullptr;  ///< of kAlone
  };

  /// What is known of one map; all of it can be had again from the store.
  struct MapState {
    StoredPlaces places;
    std::unordered_map<SessionId, PlacementWords> fragments;
    FragmentIndex unmerged;                             ///< keyframes of fragments
    std::unordered_map<SessionId, Pose3> last_checked;  ///< T_map_camera of the last doubtful keyframe looked at
  };

  Impl(MapStore& map_store, TileCache& tile_cache, SessionEvents& session_events, const RegistrarOptions& opts)
      : store(map_store),
        tiles(tile_cache),
        events(session_events),
        options(opts),
        refiner(store, tiles, events, options),
        loop_closer(store, tiles, events, options),
        worker(kMaxWaitingFrames, [this](const Task& task) { Run(task); }) {}

  void Run(const Task& task);
  /// Tiles and indices share one limit: of the frames indexed, and those about to be.
  void MakeRoomForIndices(size_t num_frames_more = 0);
  Status Process(const Task& task);
  Status ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// Asks one keyframe where its session lies and adds its word to `consensus`.
  StatusOr<AlignmentTried> TryKeyframe(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                       AlignmentConsensus& consensus) const;
  StatusOr<AlignmentConsensus*> ConsensusOf(MapReader& reader, const FrameRecord& newest, MapState& state) const;
  /// Merges the fragment of `frame` if its keyframes have agreed on a place and the way around it does not contradict
  /// it.
  Status MergeIfDecided(MapReader& reader, const FrameRecord& frame, AlignmentConsensus& consensus, MapState& state);
  Status Merge(MapReader& reader, const FrameRecord& frame, const Sim3& S_map_session, MapState& state);
  /// Tries the fragments again that have a keyframe like this frame of the map.
  Status RecallFragments(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// A close look at a doubtful keyframe, unless it shows what the one before it did.
  Status CheckDoubtful(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// Nothing more is to come that what is remembered of the session would serve.
  void ForgetClosed(const Task& task);
  void QueueClosed(MapId map, SessionId session);
  void ForgetQuarantined(const Task& task);
  Status TakeUpReleased(const Task& task);
  Status TakeUpMap(MapId map);
  Status TryAgain(MapReader& reader, const FrameView& view, MapState& state);
  /// Where a loop is closed, what was said of the map as it was is forgotten.
  Status CloseLoops(MapReader& reader, const FrameRecord& frame, MapState& state);

  /// The map's state, its index filled from the store when that is not up to date.
  StatusOr<MapState*> StateOf(MapReader& reader, MapId map);
  /// Those of the map to its index, those of fragments to that of fragments.
  static Status AddFrames(MapReader& reader, MapId map, std::optional<SessionId> session, MapState& state);

  MapStore& store;
  TileCache& tiles;
  SessionEvents& events;
  const RegistrarOptions options;

  std::atomic<bool> stopping = false;
  // Of the worker's thread alone.
  PlacementRefiner refiner;
  LoopCloser loop_closer;
  std::unordered_map<MapId, MapState> maps;

  Mutex mutex;
  /// Maps some of whose frames never reached the queue.
  std::set<MapId> behind ABSL_GUARDED_BY(mutex);

  SerialWorker<Task> worker;  ///< last: its thread uses all of the above
};

}  // namespace mapp
