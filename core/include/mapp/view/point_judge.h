#pragma once

#include "mapp/base/id.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"
#include "mapp/view/seen_geometry.h"
#include "mapp/view/sighted_points.h"

#include <Eigen/Core>

#include <cstdint>
#include <limits>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

namespace mapp {

/// Cosine of the greatest angle between two rays to a point that see it alike, 50 degrees (OVERLAP study).
inline constexpr float kLikeViewCosine = 0.6427876F;

/// What views of one session say of a point together.
struct PointFinding {
  MapPointId point;
  uint16_t num_seen = 0;    ///< views that measured a surface there
  uint16_t num_missed = 0;  ///< views that should have, and measured what lies beyond
  friend bool operator==(const PointFinding&, const PointFinding&) = default;
};

/// A keyframe that stands in the map, as a judge of its points: where it looked from, and where it measured surfaces.
struct MeasuredView {
  /// `scale`: of the keyframe's depths (SessionRecord::scale_map_session). `with_range_m`: h of the map.
  MeasuredView(const Keyframe& keyframe, const Pose3& with_T_map_camera, const Camera& with_camera, double with_range_m,
               double scale);

  Pose3 T_map_camera;
  Camera camera;
  double range_m = 0;
  /// False: redundancy control has taken out what the map held, without a raster of it: it misses nothing.
  bool complete = true;
  SeenGeometry geometry;
  Aabb box_map;  ///< around all that it can tell of
};

/// Whether a view along `ray` (from the camera to a point, metres) shows the point as one that it was seen from does:
/// from a like direction, and from where a pyramid of `num_levels` octaves reaches it. `directions`: unit vectors to
/// the point from where it was seen; `reference_distance_m`: as TilePoint's.
bool IsSeenAsBefore(std::span<const Eigen::Vector3f> directions, float reference_distance_m, const Eigen::Vector3f& ray,
                    double focal_px, int num_levels);

/// Ratio of the distance to a corner of the image to its depth: how much further than its farthest depth a view
/// reaches.
double GreatestSecant(const Camera& camera);

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

/// Counts over the views of one session which points were seen where they should have been (DESIGN 10): on the server
/// over stored keyframes, on a device over frames that it localised on a shared map. Not thread-safe.
class PointJudge {
 public:
  /// Points that sessions after `last_founder` brought are not judged.
  explicit PointJudge(const PointJudgeOptions& options,
                      SessionId last_founder = SessionId(std::numeric_limits<uint64_t>::max()))
      : options_(options), last_founder_(last_founder) {}

  /// `tiles`: those that meet the view's box.
  void Add(const MeasuredView& view, std::span<const SightedPoints> tiles);
  /// As if the other's views had been added here.
  void Merge(PointJudge&& other);
  /// Judged points by ascending id. Missed ones whose neighbours were seen are left out. A point that came in two
  /// versions of its tile stands there twice.
  std::vector<PointFinding> Conclude(int num_threads = 1) const;

 private:
  /// Of the session's nearest views of the point: what is told apart grows with the distance.
  struct Counts {
    uint16_t num_seen = 0, num_missed = 0;
    int8_t ring = std::numeric_limits<int8_t>::max();
    /// Whether a view from that ring counts. Forgets what was counted from further away.
    bool CountsFrom(int8_t view_ring);
    void Merge(const Counts& other);
    bool judged() const { return num_seen + num_missed > 0; }
    /// More views than one in five saw it: then it is there, and others looked past it.
    bool missed() const { return num_missed > 4 * num_seen; }
  };

  static void Count(SurfaceSighting sighting, int8_t ring, bool is_complete, Counts& counts);

  PointJudgeOptions options_;
  SessionId last_founder_;
  std::unordered_map<SightedPoints, std::vector<Counts>> counts_;
};

/// Adds up what is said of the same point, saturating. `findings`: by ascending id, as the result.
std::vector<PointFinding> MergeFindings(std::span<const PointFinding> findings);

}  // namespace mapp
