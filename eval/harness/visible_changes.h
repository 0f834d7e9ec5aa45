#pragma once

#include "mapp/base/status.h"
#include "sim/features/feature_world.h"
#include "sim/world/visit.h"

#include <memory>
#include <span>
#include <vector>

namespace mapp {

struct SortedChanges {
  std::vector<sim::WorldChange> visible;
  std::vector<sim::WorldChange> others;
};

/// Visible are the world's changes that can be told from the visits: a visit before had the thing's old place and its
/// new one in view, and so had one after. For what is not there at a visit's time, it is asked what that visit would
/// have seen of the thing. What took the place of another thing between the same two visits is not visible. Errors are
/// FeatureCamera::Create's.
StatusOr<SortedChanges> SortChanges(const std::shared_ptr<const sim::FeatureWorld>& world,
                                    std::span<const sim::Visit> visits);

}  // namespace mapp
