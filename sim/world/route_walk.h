#pragma once

#include "mapp/base/status.h"
#include "sim/world/world.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mapp::sim {

/// How long the walks go on beyond the length asked for: smoothing cuts corners.
constexpr double LengthWithMargin(double length_m) { return 1.3 * length_m + 6; }

/// Walks of `num_users` users along the graph's edges, as the nodes they pass: each LengthWithMargin(length_m) long or
/// a little more, turning back only in dead ends; half of them are near their start again after `length_m`. Walk k
/// does not depend on the walks after it. Every walk but the first shares a stretch, between a quarter and half of
/// `length_m`, with an earlier one, mostly in the same direction.
/// FAILED_PRECONDITION: a graph without edges, or with an edge that is no way between two places.
StatusOr<std::vector<std::vector<size_t>>> PlanWalks(const RouteGraph& graph, int num_users, double length_m,
                                                     uint64_t seed);

}  // namespace mapp::sim
