#pragma once

#include "mapp/base/status.h"
#include "mapp/map/keyframe.h"

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

}  // namespace mapp
