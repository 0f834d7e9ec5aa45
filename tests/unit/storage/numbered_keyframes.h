#pragma once

#include "mapp/map/keyframe.h"
#include "storage/map_store.h"

#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

inline constexpr uint16_t kPointsPerNumberedKeyframe = 8;

/// A keyframe of which everything follows from its session and number, so that it can be told whether it is whole.
Keyframe NumberedKeyframe(SessionId session, uint32_t number, uint16_t num_features = 40);

/// Writes it with points of its own, every third keyframe's in the session's frame. `session`: its id, map and camera.
Status AddNumberedKeyframe(MapWriter& writer, const SessionRecord& session, uint32_t number,
                           uint16_t num_features = 40);

struct NumberedUpload {
  uint64_t session;
  uint32_t number;
};

/// What is wrong with a store to which nothing but numbered keyframes were written, a revision each: every acknowledged
/// one is there once, and each that is there is whole.
std::vector<std::string> FindLostKeyframes(MapReader& reader, const std::vector<NumberedUpload>& acknowledged,
                                           uint16_t num_features = 40);

}  // namespace mapp
