#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace mapp {

/// A session of the rendered room, drawn while it plays.
struct RoomSpec {
  static constexpr uint32_t kMaxSession = 1000;

  uint64_t seed = 1;     ///< of the room itself: sessions of one seed walk through the same room
  uint32_t session = 0;  ///< range [0, kMaxSession]
};

/// `sim:room/SESSION` or `sim:room:SEED/SESSION`; nullopt when `text` has not that form.
std::optional<RoomSpec> ParseRoomSpec(const std::string& text);

/// INVALID_ARGUMENT: a name that begins with `sim:` but stands for nothing, saying why.
Status CheckSequenceName(const std::string& name);

/// Opens what `mapp replay` takes as SEQUENCE: the rendered room or a visit of a simulated world (ParseVisitSpec())
/// when the name begins with `sim:`, else a folder (OpenSequence). Errors as CheckSequenceName(), OpenSequence() and
/// sim::Simulate().
StatusOr<std::unique_ptr<Sequence>> OpenSequenceSource(const std::string& name);

}  // namespace mapp
