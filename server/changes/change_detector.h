#pragma once

#include "mapp/base/call_context.h"
#include "server/changes/change_pairing.h"
#include "server/changes/presence.h"
#include "server/changes/session_findings.h"
#include "server/changes/thing_groups.h"
#include "server/changes/thing_memory.h"
#include "server/changes/thing_stay.h"
#include "server/changes/thing_visits.h"
#include "storage/records.h"

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace mapp {

class MapReader;

struct DerivationOptions {
  GroupingOptions grouping;
  PresenceOptions presence;
  /// Less likely changes are left out.
  double min_confidence = 0.8;
  ThingVisitOptions visits;
  StayOptions stay;
  PairingOptions pairing;
  /// Fewer points that tell of a change are chance, but for those of a sample (grouping.min_points).
  size_t min_points = 40;
  /// Boxes: share of a thing's points at either end that are taken for strays, and the least length of a side.
  double stray_share = 0.06;
  double min_side_m = 0.05;
  /// What is lower than this is taken for a patch of floor or ceiling: seen at a flat angle, they come and go.
  double min_height_m = 0.6;
  /// Parts of one thing that changed alike lie no further apart than this.
  double max_part_gap_m = 0.3;
  /// Around a thing's box, where the map's other points are asked; what stays there is at most this share of all.
  double place_margin_m = 0.05;
  double max_stayed_share = 0.4;
  /// Sessions opened in [from, to] tell, Unix time.
  int64_t from_ns = std::numeric_limits<int64_t>::min();
  int64_t to_ns = std::numeric_limits<int64_t>::max();
  int num_threads = 2;
};

/// The changes that findings tell of, by the time by which they had happened; ids, status and revision are
/// left to the caller. The same findings give the same changes, with what `memory` keeps of an earlier derivation (by
/// the same options) and without. `sessions`: all of the map; `frames`: those that stand in it.
StatusOr<std::vector<ChangeRecord>> DeriveChanges(const CallContext& context, MapReader& reader, MapId map,
                                                  std::span<const SessionRecord> sessions,
                                                  std::span<const FrameRecord> frames,
                                                  std::span<const SessionFindings> findings, FindingsMaker& maker,
                                                  const DerivationOptions& options, ThingMemory& memory);

}  // namespace mapp
