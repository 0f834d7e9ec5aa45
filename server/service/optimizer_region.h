#pragma once

#include "server/service/optimizer.h"
#include "storage/map_store.h"
#include "vision/bundle_adjustment.h"

#include <span>
#include <unordered_set>
#include <vector>

namespace mapp {

/// The part of a map that one optimisation works on, as one snapshot has it (DESIGN 8).
struct OptimizerRegion {
  /// A frame that moves although the adjustment does not hold it by itself: too few of its points are shared. It keeps
  /// its place relative to the free frame next to it.
  struct CarriedFrame {
    FrameRecord record;
    int reference_idx = 0;  ///< of `frames`
  };
  /// A point that only one frame of the region sees: it keeps its place relative to that frame.
  struct CarriedPoint {
    PointRecord record;
    FrameId frame;
  };

  BundleProblem problem;
  std::vector<FrameRecord> frames;        ///< per problem.frames
  std::vector<PointRecord> points;        ///< per problem.points
  std::vector<Observation> observations;  ///< per problem.observations
  std::vector<CarriedFrame> carried_frames;
  std::vector<CarriedPoint> carried_points;
  /// What the snapshot held here, free or not: a later frame or point in `box_map` that is none of these arrived while
  /// the adjustment ran.
  Aabb box_map;  ///< empty: only frames of led_sessions go along
  std::unordered_set<FrameId> known_frames;
  std::unordered_set<MapPointId> known_points;
  /// Sessions whose frames of that kind go along wherever they are: what comes next will be placed by them.
  std::vector<SessionId> led_sessions;

  int num_free_frames() const;
  /// Index of the adjusted frame that `frame` keeps its place to: of its own session the next in number, else the
  /// nearest. Requires at least one frame.
  int ReferenceOf(const FrameRecord& frame) const;
};

/// Reads the region around `session_frames` (frames in the map): they and the frames that share at least
/// options.min_shared_points points with them are free, at most options.max_free_frames in all; further frames that see
/// the free points are the fixed border. The founder's first frame is always fixed; the earliest one, where there is
/// nothing else to hold on to. Empty when there is nothing to
/// adjust. Errors: the reader's, and CANCELLED or DEADLINE_EXCEEDED of `context`.
StatusOr<OptimizerRegion> LoadOptimizerRegion(const CallContext& context, MapReader& reader,
                                              std::span<const FrameRecord> session_frames,
                                              const OptimizerOptions& options);

/// Root mean square reprojection error over all observations, weighted by 1 / sigma, pixels. An observation counts at
/// most kTruncationPx, as one behind the camera does, so that what an adjustment gave up on neither hides nor rules.
double ReprojectionRmse(const BundleProblem& problem);
inline constexpr double kTruncationPx = 8.0;

}  // namespace mapp
