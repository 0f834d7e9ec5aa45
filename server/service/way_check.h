#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "server/service/own_frames.h"
#include "server/service/view_agreement.h"
#include "storage/records.h"

namespace mapp {

class MapReader;

/// Compares the part of `way` around a keyframe of it with the rest of the map, were the session to lie at
/// `S_map_session`: cells that agree and that contradict (view_agreement.h), summed over some keyframes before and
/// after `at`. A view of one thing that stands in two places says nothing about which of them it is; what was on the
/// way to and from it does. Views of ground that the map does not hold say nothing either. Errors are the reader's.
StatusOr<ViewAgreement> CompareWayWithMap(MapReader& reader, const FrameRecord& at, const Sim3& S_map_session,
                                          const OwnFrames& way);

}  // namespace mapp
