#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/point_search.h"
#include "client_sdk/src/tracker/relocalizer.h"
#include "client_sdk/src/tracker/session_map.h"
#include "mapp/client/orb_tracker.h"
#include "mapp/client/shared_map.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace mapp::tracker {

/// Localization on maps that the server shared, and what stays of them.
///
/// A shared map is *tried* until some frames in a row localize on it and agree on how far the device's own poses were
/// off: one frame's pose may rest on points that other devices placed a little differently, and all that follows would
/// inherit its error. Then it is *adopted*: it begins a new generation of
/// the session's map, and what the device had mapped before is retired, since it may be off from the shared points by
/// the alignment's error and would pull the pose back. An adopted map's points stay known after LeaveSharedMap, as
/// fixed points that new keyframes observe under the server's ids. A map that was never adopted leaves no trace.
/// Tracking thread only.
class SharedLocalizer {
 public:
  struct Outcome {
    uint32_t shared_map_number = 0;
    bool localized = false;
    bool newly_adopted = false;
    bool undecided = false;  ///< localized on a tried map that further frames have yet to confirm
    int num_matches = 0;
    PoseEstimate estimate;  ///< valid when localized
  };

  SharedLocalizer(SharedSessionMap& shared, const TrackingCamera& camera, const OrbTrackerOptions& options)
      : shared_(shared), camera_(camera), options_(options) {}

  /// Begins to use a map. Returns a generation to retire: that of a map tried before and never adopted.
  std::optional<int> Take(const SharedMap& map);
  /// Stops using the map. `was_adopted` tells whether mapping goes on among its points. Returns as Take.
  std::optional<int> Leave(bool* was_adopted);

  bool in_use() const { return in_use_; }
  /// Of the map adopted last, which must be.
  const Pose3& T_map_session() const { return adopted_->T_map_session; }
  /// Localizes a frame on the map in use. `guess` is absent when tracking is lost; what is found without its help must
  /// lie within `bound`.
  Outcome Localize(const Frame& frame, const std::optional<Pose3>& T_session_camera_guess, const PoseBound& bound,
                   const Relocalizer& relocalizer);
  /// Points of the map adopted last: known points of the present generation.
  std::span<const PointView> known_points() const;
  /// The part of the session's map in use. Grows with each adoption.
  int generation() const { return adopted_ ? adopted_->generation : 0; }

  /// Matches below which a frame of `num_features` features is not localized: `min_shared_matches` (75), or 40 % of the
  /// features where an image has so few that 75 could not be asked of it, but never below `min_tracked_points`.
  static int RequiredMatches(size_t num_features, const OrbTrackerOptions& options);

 private:
  struct Loaded {
    uint32_t number = 0;
    int generation = 0;
    Pose3 T_map_session;
    std::vector<PointView> points;
  };

  /// Whether a frame's pose on the tried map completes what adopting it takes.
  bool Confirms(const Pose3& T_session_camera, const std::optional<Pose3>& T_session_camera_guess);
  PoseEstimate EstimateOn(const Loaded& map, const Frame& frame, const std::optional<Pose3>& T_session_camera_guess,
                          const PoseBound& bound, const Relocalizer& relocalizer);

  SharedSessionMap& shared_;
  const TrackingCamera& camera_;
  const OrbTrackerOptions& options_;
  std::optional<Loaded> tried_;
  std::optional<Loaded> adopted_;
  std::vector<Pose3>
      corrections_;        ///< T_map_session of the last frames on the tried map, the session's frame being off
  int num_undecided_ = 0;  ///< frames that have localized on the tried map
  bool in_use_ = false;
  bool first_frame_ = false;  ///< of the map in use
  int last_generation_ = 0;
};

}  // namespace mapp::tracker
