#pragma once

#include <compare>
#include <cstdint>
#include <functional>

namespace mapp {

/// A strongly typed 64-bit identifier: an `Id<A>` never converts to an `Id<B>`. Value 0 is never handed out;
/// "no id" is `std::optional`, not a sentinel.
template <typename Tag>
class Id {
 public:
  constexpr Id() = default;
  constexpr explicit Id(uint64_t value) : value_(value) {}
  constexpr uint64_t value() const { return value_; }
  friend constexpr auto operator<=>(Id, Id) = default;

 private:
  uint64_t value_ = 0;
};

using MapId = Id<struct MapIdTag>;
/// `C` of the paper: one device's continuous run in one map. Fits 32 bits so that the overlap query fits 64 bytes.
using SessionId = Id<struct SessionIdTag>;
using CameraId = Id<struct CameraIdTag>;
/// A keyframe once it stands in a map.
using FrameId = Id<struct FrameIdTag>;
using MapPointId = Id<struct MapPointIdTag>;
/// A change of the world that a map's history tells of.
using ChangeId = Id<struct ChangeIdTag>;
/// Grows with every commit to a map; 0 is the empty map.
using Revision = Id<struct RevisionTag>;

}  // namespace mapp

template <typename Tag>
struct std::hash<mapp::Id<Tag>> {
  size_t operator()(mapp::Id<Tag> id) const noexcept { return std::hash<uint64_t>{}(id.value()); }
};
