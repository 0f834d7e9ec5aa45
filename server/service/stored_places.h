#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "vision/place_index.h"

#include <functional>

namespace mapp {

class MapReader;
class MapStore;

/// The place index of one map, kept in its database: a start reads the stored blocks and only those keyframes that came
/// after the last one. One thread only.
class StoredPlaces {
 public:
  /// Told of a stored block that cannot be used: its keyframes are read instead. May be empty.
  using OnDamage = std::function<void(const Status&)>;

  StoredPlaces(MapStore& store, MapId map) : store_(store), map_(map) {}

  /// Reads the stored blocks: frames that are in the map. Errors are the reader's.
  Status Load(MapReader& reader, const OnDamage& on_damage);
  /// Adds a frame of the map that is not there yet; stores what is new when there is enough of it. Errors:
  /// LoadDescriptors' and the store's.
  Status Add(MapReader& reader, FrameId frame);
  void Remove(FrameId frame) { index_.Remove(frame.value()); }
  /// Stores what is new. Errors: the store's; what could not be stored is in the index all the same.
  Status Store();

  const PlaceIndex& index() const { return index_; }

 private:
  MapStore& store_;
  const MapId map_;
  PlaceIndex index_{PlaceIndex::Options{}};
};

}  // namespace mapp
