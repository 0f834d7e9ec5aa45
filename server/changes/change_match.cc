#include "server/changes/change_match.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <utility>

namespace mapp {
namespace {

bool ShareHalf(const std::vector<MapPointId>& a, const std::vector<MapPointId>& b) {
  if (a.empty() || b.empty()) return false;
  std::vector<MapPointId> common;
  std::ranges::set_intersection(a, b, std::back_inserter(common));
  return 2 * common.size() >= std::min(a.size(), b.size());
}

bool AreOfOnePlace(const std::optional<OrientedBox>& a, const std::optional<OrientedBox>& b) {
  if (!a || !b) return false;
  return a->Contains(b->T_frame_box.translation(), 0) || b->Contains(a->T_frame_box.translation(), 0);
}

}  // namespace

bool IsSameEvent(const ChangeRecord& a, const ChangeRecord& b) {
  const bool is_like_kind = a.kind == b.kind || a.kind == ChangeKind::kMoved || b.kind == ChangeKind::kMoved;
  if (!is_like_kind || std::max(a.after_ns, b.after_ns) >= std::min(a.before_ns, b.before_ns)) return false;
  return ShareHalf(a.points_before, b.points_before) || ShareHalf(a.points_after, b.points_after) ||
         AreOfOnePlace(a.box_before, b.box_before) || AreOfOnePlace(a.box_after, b.box_after);
}

ChangeUpdate MatchChanges(std::span<const ChangeRecord> stored, std::vector<ChangeRecord> found, int64_t from_ns,
                          int64_t to_ns) {
  ChangeUpdate update;
  std::set<ChangeId> matched;
  for (ChangeRecord& change : found) {
    const auto same = std::ranges::find_if(
        stored, [&](const ChangeRecord& known) { return !matched.contains(known.id) && IsSameEvent(known, change); });
    if (same == stored.end()) {
      update.fresh.push_back(std::move(change));
      continue;
    }
    matched.insert(same->id);
    if (same->status != ChangeStatus::kProposed) {
      update.known.push_back(*same);
      continue;
    }
    change.id = same->id;
    change.detected = same->detected;
    update.known.push_back(std::move(change));
  }
  for (const ChangeRecord& known : stored) {
    const bool in_time = known.after_ns >= from_ns && known.before_ns <= to_ns;
    if (known.status == ChangeStatus::kProposed && in_time && !matched.contains(known.id)) {
      update.dropped.push_back(known.id);
    }
  }
  return update;
}

}  // namespace mapp
