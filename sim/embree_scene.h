#pragma once

#include "sim/scene.h"

#include <cstddef>
#include <cstdint>
#include <span>

struct RTCFilterFunctionNArguments;
struct RTCSceneTy;

namespace mapp::sim {

/// Rectangles in an acceleration structure of Embree. A hit's primID is the index in `quads`, its geomID the
/// `geometry_id` given. Which sides are met is the business of the query's filter, as set in its RTCIntersectContext.
/// Immutable, thread-safe; the quads need not outlive it.
class EmbreeScene {
 public:
  /// For how long the structure is used: one built for a single frame is built faster and traced slower.
  enum class Lifetime { kLong, kOneFrame };

  EmbreeScene(std::span<const Quad> quads, uint32_t geometry_id, Lifetime lifetime);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  /// Filter with which rays meet fronts only and pass through backs.
  static void RejectBacks(const RTCFilterFunctionNArguments* arguments);

  RTCSceneTy* handle() const { return scene_; }

 private:
  RTCSceneTy* scene_;
};

}  // namespace mapp::sim
