#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/oriented_box.h"
#include "storage/records.h"

#include <vector>

namespace mapp {

class MapReader;

struct PairingOptions {
  /// Descriptors this near to each other are of one place on a thing, bits of 256. Unlike ones are 128 apart, and the
  /// nearest of a thousand of them some 90.
  int max_distance_bits = 50;
  /// A thing is known again by so many points, and this share of those that it shows at its new place. Of simulated
  /// cars 40 and more were alike when they were the same, up to 12 when they were two.
  size_t min_points = 20;
  double min_share = 0.1;
};

struct FoundChange {
  ChangeRecord change;   ///< with the box of the whole thing
  OrientedBox seen_box;  ///< of what was seen of it
};

/// Changes of which one may be a part of another, with the same kind and time, as one: what was seen with its centre in
/// another's box, or as far above it as that is high, is taken into it. The one with more points says where the thing
/// is.
std::vector<ChangeRecord> JoinInside(std::vector<FoundChange> found);

/// What vanished and appeared elsewhere at the same time, looking the same, has moved: one record for two, the surest
/// pairs first.
StatusOr<std::vector<ChangeRecord>> PairMoved(MapReader& reader, std::vector<ChangeRecord> changes,
                                              const PairingOptions& options);

}  // namespace mapp
