#pragma once

#include "server/changes/point_history.h"

#include <Eigen/Core>

#include <compare>
#include <set>
#include <span>
#include <vector>

namespace mapp {

/// Whether two points may be of one thing, by their visits around a time: some session found both gone, and hardly any
/// found only one of them there.
bool TellTheSame(std::span<const PointCourse::Visit> a, std::span<const PointCourse::Visit> b);

/// Something came (or went) before this session, and after the one before it.
struct GroupEvent {
  SessionId session;
  bool came = false;
  friend auto operator<=>(const GroupEvent&, const GroupEvent&) = default;
};

/// One change of a point: from one visit of its course to the next.
struct PointChange {
  size_t point = 0;  ///< index of its course
  size_t visit = 0;
};

/// A thing that came or went: points near to each other that did so at one time.
struct ChangedThing {
  GroupEvent event;
  std::vector<PointChange> points;  ///< by point
  /// Things of one number hung together until they were split at necks.
  size_t group = 0;
};

struct GroupingOptions {
  float gap_m = 0.5F;  ///< points of one thing have a neighbour within it
  /// Likewise at events of `sampled`: by sessions that tell of a sample of points alone (codec/evidence_codec.h), so
  /// that what they tell of lies further apart.
  float sampled_gap_m = 1.0F;
  std::set<SessionId> sampled = {};
  size_t min_points = 8;  ///< fewer are noise
  int num_threads = 1;
};

/// Parts that a thing falls into, seen from above, when what is sparse between them is left out: things that stand side
/// by side, with a few stray points between. `p_map` has a place for each of the thing's points; indices are into it.
std::vector<std::vector<size_t>> SplitAtNecks(std::span<const Eigen::Vector3f> p_map, const Eigen::Vector3f& up_map);

/// For each time at which points came or went: groups of those that are linked over gaps of at most gap_m and tell the
/// same (single linkage). Where it cannot be told between which visits a point changed, it goes with the largest group
/// that it may belong to. `p_map` has a place for each course.
std::vector<ChangedThing> GroupThings(std::span<const PointCourse> courses, std::span<const Eigen::Vector3f> p_map,
                                      const Eigen::Vector3f& up_map, const GroupingOptions& options);

}  // namespace mapp
