#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/view/point_judge.h"

#include <vector>

namespace mapp {

class MapReader;

/// What the session's device has reported of the map's points while it localised on shared maps (DESIGN 10), all its
/// reports together, by ascending id; empty when it has sent none. The counts mean what those of PointJudge::Conclude
/// over stored keyframes mean, but:
///  - they are of one point in kEvidenceOneIn (codec/evidence_codec.h), chosen by id: a thing of which keyframes judge
///    100 points has some 6 here;
///  - points may have been retired since, and may have been brought by later sessions;
///  - of a session without frames in the map they are one device's word (SessionRecord::device) that nobody can look
///    into again: there are no views behind them. A device that is wrong is wrong about all of its points alike.
/// DATA_LOSS names session and report.
StatusOr<std::vector<PointFinding>> FindingsOfEvidence(MapReader& reader, SessionId session);

}  // namespace mapp
