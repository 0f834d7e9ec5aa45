#pragma once

#include "server/changes/point_tiles.h"
#include "server/changes/witness_views.h"

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

/// What frames of one session say of a point together.
struct PointFinding {
  MapPointId point;
  uint16_t num_seen = 0;    ///< views that measured a surface there
  uint16_t num_missed = 0;  ///< views that should have, and measured what lies beyond
  friend bool operator==(const PointFinding&, const PointFinding&) = default;
};

struct PointJudgeOptions {
  /// Nearest judged neighbours that a missed point is compared with (K of the paper), within which distance, and how
  /// many of them must be missed as well: things vanish whole, points that a detector passes over do so alone.
  size_t num_neighbors = 8;
  float neighbor_radius_m = 0.6F;
  double min_missed_neighbor_ratio = 0.5;
  /// Points this near to the image border may have been cut off by the pose's error, pixels.
  double image_margin_px = 16;
  /// Octaves of the extractor's pyramid: what is nearer than its coarsest level shows is not expected to be detected.
  int num_levels = 8;
};

/// Counts over the views of one session which points were seen where they should have been (DESIGN 10).
class PointJudge {
 public:
  /// `is_asked(const SightedPoint&)`: points that are to be judged.
  PointJudge(const PointJudgeOptions& options, std::function<bool(const SightedPoint&)> is_asked)
      : options_(options), is_asked_(std::move(is_asked)) {}

  /// `tiles`: those that meet the view's box.
  void Add(const WitnessView& view, std::span<const PointTiles::Points> tiles);
  /// Judged points by ascending id. Missed ones whose neighbours were seen are left out.
  std::vector<PointFinding> Conclude() const;

 private:
  /// Of the session's nearest views of the point: what is told apart grows with the distance.
  struct Counts {
    uint16_t num_seen = 0, num_missed = 0;
    int8_t ring = std::numeric_limits<int8_t>::max();
    /// Whether a view from that ring counts. Forgets what was counted from further away.
    bool CountsFrom(int8_t view_ring);
    bool judged() const { return num_seen + num_missed > 0; }
    /// More views than one in five saw it: then it is there, and others looked past it.
    bool missed() const { return num_missed > 4 * num_seen; }
  };

  PointJudgeOptions options_;
  std::function<bool(const SightedPoint&)> is_asked_;
  std::unordered_map<PointTiles::Points, std::vector<Counts>> counts_;
};

}  // namespace mapp
