#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "vision/place_index.h"

#include <functional>
#include <utility>

namespace mapp {

class MapReader;
class MapStore;

/// The place index of one map, kept in its database: a start reads the stored blocks and only those keyframes that came
/// after the last one. One thread only.
class StoredPlaces {
 public:
  /// Told, with the map's number, of a stored block that cannot be used and of one that cannot be stored: both are only
  /// missed at the next start, which reads their keyframes instead. May be empty.
  using OnTrouble = std::function<void(const Status&)>;

  StoredPlaces(MapStore& store, MapId map, OnTrouble on_trouble)
      : store_(store), map_(map), on_trouble_(std::move(on_trouble)) {}

  /// Reads the stored blocks: frames that are in the map. Errors are the reader's.
  Status Load(MapReader& reader);
  /// Adds a frame of the map that is not there yet; stores what is new when there is enough of it. Errors are
  /// LoadDescriptors'.
  Status Add(MapReader& reader, FrameId frame);
  void Remove(FrameId frame) { index_.Remove(frame.value()); }
  /// Stores what is new.
  void Store();

  const PlaceIndex& index() const { return index_; }

 private:
  void TellTrouble(const Status& status) const;

  MapStore& store_;
  const MapId map_;
  const OnTrouble on_trouble_;
  PlaceIndex index_{PlaceIndex::Options{}};
};

}  // namespace mapp
