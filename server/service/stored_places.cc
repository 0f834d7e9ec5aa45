#include "server/service/stored_places.h"

#include "server/service/frame_view.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <string>
#include <unordered_set>

namespace mapp {

void StoredPlaces::TellTrouble(const Status& status) const {
  if (!on_trouble_) return;
  on_trouble_(Status(status.code(), fmt::format("map {}: {}", map_.value(), std::string(status.message()))));
}

Status StoredPlaces::Load(MapReader& reader) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<std::string> blocks, reader.ListPlaceBlocks(map_));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map_, std::nullopt));
  std::unordered_set<uint64_t> in_map;
  for (const FrameRecord& frame : frames) {
    if (frame.in_map) in_map.insert(frame.id.value());
  }
  for (const std::string& bytes : blocks) {
    const StatusOr<PlaceBlock> block = DecodePlaceBlock(bytes);
    const Status added =
        block.ok() ? index_.AddBlock(*block, [&in_map](uint64_t id) { return in_map.contains(id); }) : block.status();
    if (!added.ok()) TellTrouble(added);
  }
  return absl::OkStatus();
}

Status StoredPlaces::Add(MapReader& reader, FrameId frame) {
  if (index_.Contains(frame.value())) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<OrbDescriptor> descriptors, LoadDescriptors(reader, frame));
  index_.Add(frame.value(), descriptors);
  if (index_.num_new_frames() == PlaceIndex::kMaxNewFrames) Store();
  return absl::OkStatus();
}

void StoredPlaces::Store() {
  if (index_.num_new_frames() == 0) return;
  const std::string block = EncodePlaceBlock(index_.SealBlock());
  const Status stored =
      store_.Write({}, [this, &block](MapWriter& writer) { return writer.AppendPlaceBlock(map_, block); });
  if (!stored.ok()) TellTrouble(stored);
}

}  // namespace mapp
