#include "cli/changed_map.h"

#include <algorithm>
#include <functional>
#include <set>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

using PointIds = std::unordered_set<uint64_t>;

bool IsAbout(PointRole role, MapMoment moment) {
  switch (role) {
    case PointRole::kUnchanged:
      return true;
    case PointRole::kVanished:
    case PointRole::kMovedFrom:
      return moment != MapMoment::kAfter;
    case PointRole::kAppeared:
    case PointRole::kMovedTo:
      return moment != MapMoment::kBefore;
  }
  return true;
}

/// The ids that points of the changes have and that none of `points` has.
PointIds Missing(const std::vector<ChangeSummary>& changes, const std::vector<MapPointSummary>& points) {
  PointIds missing;
  for (const ChangeSummary& change : changes) {
    missing.insert(change.points_before.begin(), change.points_before.end());
    missing.insert(change.points_after.begin(), change.points_after.end());
  }
  for (const MapPointSummary& point : points) missing.erase(point.id);
  return missing;
}

/// Of the points, those that are missing, which they are no more then.
std::vector<MapPointSummary> Take(const std::vector<MapPointSummary>& points, PointIds& missing) {
  std::vector<MapPointSummary> taken;
  for (const MapPointSummary& point : points) {
    if (missing.erase(point.id) > 0) taken.push_back(point);
  }
  return taken;
}

}  // namespace

Color ColorOf(PointRole role) {
  switch (role) {
    case PointRole::kVanished:
      return kVanishedColor;
    case PointRole::kAppeared:
      return kAppearedColor;
    case PointRole::kMovedFrom:
      return kMovedFromColor;
    case PointRole::kMovedTo:
      return kMovedToColor;
    case PointRole::kUnchanged:
      break;
  }
  return {160, 160, 160};
}

StatusOr<ChangedMap> FetchChangedMap(const std::string& map_name, std::vector<ChangeSummary> changes,
                                     AdminClient& client) {
  ChangedMap map;
  map.changes = std::move(changes);
  MAPP_ASSIGN_OR_RETURN(map.now, client.ExportMap(map_name));
  PointIds missing = Missing(map.changes, map.now.points);
  // Newest first: a point stands where it stood last. All of one acceptance were there just before it.
  std::set<uint64_t, std::greater<>> applied;
  for (const ChangeSummary& change : map.changes) {
    if (change.applied_revision > 0) applied.insert(change.applied_revision);
  }
  for (const uint64_t revision : applied) {
    if (map.points_then && missing.empty()) break;
    StatusOr<MapContent> then = client.ExportMap(map_name, std::to_string(revision - 1));
    if (absl::IsOutOfRange(then.status())) break;  // compacted away, and so is what is older
    MAPP_RETURN_IF_ERROR(then.status());
    const std::vector<MapPointSummary> taken = Take(then->points, missing);
    map.retired.insert(map.retired.end(), taken.begin(), taken.end());
    if (!map.points_then) map.points_then = std::move(then->points);
  }
  map.num_lost = missing.size();
  return map;
}

PointRoles::PointRoles(const std::vector<ChangeSummary>& changes) {
  for (const ChangeSummary& change : changes) {
    const bool moved = change.kind == ChangeKind::kMoved;
    for (const uint64_t id : change.points_before) {
      roles_[id] = moved ? PointRole::kMovedFrom : PointRole::kVanished;
    }
  }
  for (const ChangeSummary& change : changes) {
    const bool moved = change.kind == ChangeKind::kMoved;
    for (const uint64_t id : change.points_after) {
      roles_.emplace(id, moved ? PointRole::kMovedTo : PointRole::kAppeared);
    }
  }
}

PointRole PointRoles::Of(uint64_t point_id) const {
  const auto found = roles_.find(point_id);
  return found == roles_.end() ? PointRole::kUnchanged : found->second;
}

std::vector<MapPointSummary> PointsAt(const ChangedMap& map, MapMoment moment) {
  const PointRoles roles(map.changes);
  const bool then = moment == MapMoment::kBefore && map.points_then;
  const std::vector<MapPointSummary>& base = then ? *map.points_then : map.now.points;
  std::vector<MapPointSummary> points;
  PointIds held;
  const auto add = [&](const std::vector<MapPointSummary>& more) {
    for (const MapPointSummary& point : more) {
      const PointRole role = roles.Of(point.id);
      if (!IsAbout(role, moment)) continue;
      if (role != PointRole::kUnchanged && !held.insert(point.id).second) continue;
      points.push_back(point);
    }
  };
  add(base);
  add(map.retired);
  return points;
}

}  // namespace mapp
