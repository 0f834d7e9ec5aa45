#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"

#include <cstdint>
#include <vector>

namespace mapp {

class MapReader;

/// Something that happened to the maps of a database, as far as its log tells.
struct LogEvent {
  enum class Kind : uint8_t { kOpened, kKeyframe, kMapOptimized, kClosed };  ///< at one time, in this order
  int64_t time_ns = 0;                                                       ///< Unix time
  Kind kind = Kind::kKeyframe;
  MapId map;
  SessionId session;  ///< not of kMapOptimized
  FrameId frame;      ///< of kKeyframe
};

/// All of them in their order: each session's opening before its keyframes and its closing after them, sessions and
/// keyframes in the order of their ids whatever the clock said.
StatusOr<std::vector<LogEvent>> ListLogEvents(MapReader& reader);

}  // namespace mapp
