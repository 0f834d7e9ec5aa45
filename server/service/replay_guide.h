#pragma once

#include "mapp/base/status.h"
#include "mapp/map/keyframe.h"

#include <cstdint>
#include <functional>

namespace mapp {

class MapReader;

/// For keyframes that were integrated once before, in another database, and are integrated again (server/rebuild).
struct ReplayGuide {
  /// Whether a keyframe may enter the map, as it was judged then: it is not judged again.
  std::function<bool(SessionId session, uint32_t number)> admits;
  /// Lets the keyframe's references to map points name those of the database that is read.
  std::function<Status(MapReader& reader, Keyframe& keyframe)> translate;
};

}  // namespace mapp
