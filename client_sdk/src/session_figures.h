#pragma once

#include "mapp/base/latency.h"
#include "mapp/client/participant.h"

#include <array>

namespace mapp {

/// What a participant's work consists of, for ParticipantLatency.
enum class Step {
  kOverlapAssessment,
  kRedundancyControl,
  kKeyframeUpload,
  kSharedMap,
  kFirstSharedTile,
  kUpdateReport
};

/// What sessions have counted, in a form that adds up.
struct SessionFigures {
  ParticipantStats counts;                 ///< but for its latencies
  std::array<LatencyRecorder, 6> latency;  ///< by Step

  LatencyRecorder& Of(Step step) { return latency.at(static_cast<size_t>(step)); }
  /// Adds a later session's. Aligned is the first of them that was; the last error is the latest, and
  /// so is the quarantine.
  SessionFigures& operator+=(const SessionFigures& later);
  ParticipantStats Summary() const;
};

}  // namespace mapp
