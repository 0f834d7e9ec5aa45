#pragma once

#include "mapp/base/id.h"
#include "server/changes/thing_course.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace mapp {

/// A thing that changed, or as much of it as was judged together.
struct ChangedPart {
  struct Point {
    MapPointId id;
    Eigen::Vector3f p_map;
    Eigen::Vector3f direction;  ///< unit, mean of (point - camera centre)
  };
  Happening happening;
  size_t group = 0;         ///< ChangedThing::group
  bool is_sampled = false;  ///< only devices that tell of a sample of points say that it is gone
  std::vector<Point> points;
};

/// Joins parts that changed alike at a time that may be one and lie at most `max_gap_m` apart: one thing may have been
/// seen in parts that no session has judged together. Those of one group were told apart and stay so. Points of each
/// part are by id, each once.
std::vector<ChangedPart> JoinParts(std::vector<ChangedPart> parts, double max_gap_m);

}  // namespace mapp
