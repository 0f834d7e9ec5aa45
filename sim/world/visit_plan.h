#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "sim/world/visit.h"

#include <cstdint>
#include <utility>
#include <vector>

namespace mapp::sim {

/// What is known of the visits before the world is: options checked, given trajectories read.
struct VisitPlan {
  std::vector<std::vector<StampedPose>> trajectories;  ///< T_world_camera, times from 0; of the files
  int64_t period_ns = 0;                               ///< from one visit's start to the next; whole hours
  int64_t longest_ns = 0;                              ///< no visit takes longer

  int64_t StartOf(int user) const { return (int64_t{user} + 1) * period_ns; }
};

/// Errors as Simulate().
StatusOr<VisitPlan> MakeVisitPlan(const SimulationOptions& options);
StatusOr<std::vector<Visit>> PlanVisits(const World& world, const SimulationOptions& options, const VisitPlan& plan);

}  // namespace mapp::sim
