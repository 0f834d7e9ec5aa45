#pragma once

#include "cli/changed_map.h"

#include <memory>

namespace mapp {

class FakeAdminService;

/// A room of 8 x 6 m, y down, in which things have changed:
///   #1 vanished, proposed: a crate at (2, 2) of the floor, points 5001 to 5060
///   #2 appeared, proposed: at (6, 4.5), points 5101 to 5160
///   #3 moved, proposed: from (1.5, 4.6), points 5201 to 5240, to (4.2, 3.2), points 5301 to 5340
///   #12 vanished, accepted at revision 41: at (6.4, 1.3); its points 5401 to 5440 are retired
///   #13 appeared, rejected: at (4, 5), points 5501 to 5520
/// The map is at revision 42.
struct ChangeScene {
  ChangeScene();

  /// What is asked for of a server that holds it; rejected ones left out.
  ChangedMap ToChangedMap() const;
  std::unique_ptr<FakeAdminService> Serve() const;

  MapContent now;   ///< the map
  MapContent then;  ///< at revision 40
  std::vector<ChangeSummary> changes;
};

}  // namespace mapp
