#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/view/point_judge.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// A device that localises on a shared map tells of one map point in so many, whether it saw or missed it: the same
/// points for all devices, chosen by their ids alone, one of each run of so many ids. Whoever compares counts of such
/// points with those of keyframes, which tell of all, has to know it.
inline constexpr uint64_t kEvidenceOneIn = 16;
/// Whether devices tell of the point.
bool IsInEvidenceSample(MapPointId point);

/// Points in one report, and its greatest size, bytes. A minute of way takes some hundred bytes.
inline constexpr size_t kMaxEvidencePoints = 4096;
inline constexpr size_t kMaxEvidenceBytes = size_t{128} << 10;

/// docs/formats/evidence.md. `findings`: at most kMaxEvidencePoints of the sample, by ascending id, none twice, each
/// with a count.
std::string EncodeEvidence(std::span<const PointFinding> findings);
/// INVALID_ARGUMENT, naming what is wrong, for what EncodeEvidence does not write.
StatusOr<std::vector<PointFinding>> DecodeEvidence(std::string_view bytes);

}  // namespace mapp
