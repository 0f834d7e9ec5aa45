#pragma once

#include "server/changes/session_findings.h"

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

namespace mapp {

/// What all sessions say of one point.
struct PointHistory {
  struct Visit {
    SessionId session;
    uint16_t num_seen = 0;
    uint16_t num_missed = 0;
    bool seen() const { return num_seen > num_missed; }
    bool missed() const { return num_missed > 4 * num_seen; }
  };
  MapPointId point;
  std::vector<Visit> visits;  ///< by session
};

/// Of the points that any session has missed, by id: all that sessions tell of the others is that they are there.
std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings);

/// Whether two points may be of one thing: some session missed both, and hardly any saw one and missed the other.
bool TellTheSame(const PointHistory& a, const PointHistory& b);

/// A thing that came or went: points near to each other with one history.
struct ChangedThing {
  std::vector<size_t> points;  ///< indices of histories, ascending
  /// Things of one number hung together until they were split at necks.
  size_t group = 0;
};

struct GroupingOptions {
  float gap_m = 0.5F;     ///< points of one thing have a neighbour within it
  size_t min_points = 8;  ///< fewer are noise
};

/// Parts that a thing falls into, seen from above, when what is sparse between them is left out: things that stand side
/// by side, with a few stray points between. `p_map` has a place for each of the thing's points; indices are into it.
std::vector<std::vector<size_t>> SplitAtNecks(std::span<const Eigen::Vector3f> p_map, const Eigen::Vector3f& up_map);

/// Groups points that are linked over gaps of at most gap_m and tell the same (single linkage). `p_map` has a place for
/// each history.
std::vector<ChangedThing> GroupThings(std::span<const PointHistory> histories, std::span<const Eigen::Vector3f> p_map,
                                      const Eigen::Vector3f& up_map, const GroupingOptions& options);

}  // namespace mapp
