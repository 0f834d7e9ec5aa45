#pragma once

#include "mapp/base/status.h"
#include "mapp/map/keyframe.h"

#include <functional>
#include <string>
#include <string_view>

namespace mapp {

/// Byte format of an uploaded keyframe: docs/formats/keyframe.md. At most 45 KB for 1000 features with points.
/// Losses: pixel position 1/16 px, angle 2 pi / 256, depth 0.01 %; observation count saturates at 255.
/// Requires what Validate() checks.
std::string EncodeKeyframe(const Keyframe& keyframe);

/// INVALID_ARGUMENT naming the field for bytes that are truncated, of another format or version, over the limits, or
/// fail their checksum.
StatusOr<Keyframe> DecodeKeyframe(std::string_view bytes);

/// The same keyframe for another session and other numbers of map points, all else byte for byte. `map_point` gives the
/// new number for an old one; 0 where there is none, which stands for no point. Requires bytes that DecodeKeyframe
/// takes.
std::string RenumberKeyframe(std::string_view bytes, SessionId session,
                             const std::function<uint64_t(uint64_t)>& map_point);

}  // namespace mapp
