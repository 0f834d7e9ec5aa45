#pragma once

#include "mapp/base/bytes.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace mapp::internal {

// docs/formats/bundle.md

inline constexpr std::string_view kBundleMagic = "MAPPBNDL";
inline constexpr uint32_t kBundleVersion = 1;
inline constexpr uint8_t kBundleEndKind = 0xff;
inline constexpr size_t kBundleHeadBytes = 8 + sizeof(uint32_t);
/// Kind and length before a record's payload; its checksum behind it.
inline constexpr size_t kBundleFrameBytes = 1 + sizeof(uint32_t);
/// Of a payload. A whole keyframe with its observations has some 60 KB.
inline constexpr size_t kMaxBundleRecordBytes = size_t{1} << 20;

}  // namespace mapp::internal
