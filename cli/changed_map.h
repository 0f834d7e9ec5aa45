#pragma once

#include "cli/admin_client.h"
#include "cli/change_colors.h"
#include "cli/change_info.h"
#include "cli/map_info.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

namespace mapp {

/// What a map point is to changes of the world.
enum class PointRole { kUnchanged, kVanished, kAppeared, kMovedFrom, kMovedTo };

/// Grey for kUnchanged.
Color ColorOf(PointRole role);

/// A map with changes of its world. Points that acceptance has retired are not in the map as it is; they come from its
/// past.
struct ChangedMap {
  MapContent now;
  std::vector<ChangeSummary> changes;
  /// Of the changes, those that are not in the map any more, where they last stood.
  std::vector<MapPointSummary> retired;
  /// Points of the map just before the latest acceptance among the changes; absent where none is accepted, or that past
  /// is compacted away.
  std::optional<std::vector<MapPointSummary>> points_then;
  /// Of the changes, those that are neither in the map nor in its past that can be read.
  size_t num_lost = 0;
};

/// Asks for the map, and for its past where acceptance of the changes retired points.
StatusOr<ChangedMap> FetchChangedMap(const std::string& map_name, std::vector<ChangeSummary> changes,
                                     AdminClient& client);

/// What points are to the changes, by id; others are kUnchanged. What is gone counts more than that it once came.
class PointRoles {
 public:
  explicit PointRoles(const std::vector<ChangeSummary>& changes);
  PointRole Of(uint64_t point_id) const;

 private:
  std::unordered_map<uint64_t, PointRole> roles_;
};

/// Which points of a changed map to look at.
enum class MapMoment {
  kBefore,  ///< as the world was before the changes: without what came
  kAfter,   ///< and after them: without what went
  kBoth,    ///< all
};
std::vector<MapPointSummary> PointsAt(const ChangedMap& map, MapMoment moment);

}  // namespace mapp
