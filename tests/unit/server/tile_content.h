#pragma once

#include "server/service/loaded_tile.h"

#include <map>
#include <set>
#include <tuple>

namespace mapp::testing {

/// What a loaded tile says of a point, comparable and independent of how the tile came about.
struct PointContent {
  std::tuple<float, float, float> p_map;
  uint32_t num_observations;
  std::set<uint64_t> observers;
  friend bool operator==(const PointContent&, const PointContent&) = default;
};

inline std::map<uint64_t, PointContent> ContentOf(const LoadedTile* tile) {
  std::map<uint64_t, PointContent> content;
  if (tile == nullptr) return content;
  tile->ForEachPoint([&](const LoadedPoint& point) {
    PointContent& entry = content[point.id.value()];
    entry.p_map = {point.p_map.x(), point.p_map.y(), point.p_map.z()};
    entry.num_observations = point.num_observations;
    for (uint32_t i = 0; i < point.num_observers; ++i) {
      entry.observers.insert(tile->frames()[point.observer_frames[i]].id.value());
    }
  });
  return content;
}

}  // namespace mapp::testing
