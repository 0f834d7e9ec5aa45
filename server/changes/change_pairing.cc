#include "server/changes/change_pairing.h"

#include "storage/map_store.h"

#include <algorithm>
#include <iterator>
#include <tuple>
#include <utility>

namespace mapp {
namespace {

bool MayBeAtOnce(const ChangeRecord& a, const ChangeRecord& b) {
  return std::max(a.after_ns, b.after_ns) < std::min(a.before_ns, b.before_ns);
}

template <typename Id>
void Unite(std::vector<Id>& into, const std::vector<Id>& more) {
  std::vector<Id> all;
  std::ranges::set_union(into, more, std::back_inserter(all));
  into = std::move(all);
}

const OrientedBox& BoxOf(const ChangeRecord& change) {
  return change.box_before ? *change.box_before : *change.box_after;
}

size_t NumPoints(const ChangeRecord& change) { return change.points_before.size() + change.points_after.size(); }

/// Of the second thing's points, those that look like one of the first's.
size_t CountAlike(const std::vector<PointRecord>& first, const std::vector<PointRecord>& second, int max_bits) {
  return static_cast<size_t>(std::ranges::count_if(second, [&](const PointRecord& point) {
    return std::ranges::any_of(first, [&](const PointRecord& other) {
      return HammingDistance(point.descriptor, other.descriptor) <= max_bits;
    });
  }));
}

void Join(ChangeRecord& vanished, ChangeRecord&& appeared) {
  vanished.kind = ChangeKind::kMoved;
  vanished.confidence = std::min(vanished.confidence, appeared.confidence);
  vanished.after_ns = std::max(vanished.after_ns, appeared.after_ns);
  vanished.before_ns = std::min(vanished.before_ns, appeared.before_ns);
  vanished.box_after = appeared.box_after;
  vanished.points_after = std::move(appeared.points_after);
  Unite(vanished.sessions, appeared.sessions);
}

}  // namespace

std::vector<ChangeRecord> JoinInside(std::vector<FoundChange> found) {
  std::ranges::stable_sort(found, std::greater(), [](const FoundChange& one) { return NumPoints(one.change); });
  std::vector<ChangeRecord> joined;
  for (auto& [change, seen_box] : found) {
    const Eigen::Vector3d& center_map = seen_box.T_frame_box.translation();
    const auto whole = std::ranges::find_if(joined, [&](const ChangeRecord& other) {
      if (other.kind != change.kind || !MayBeAtOnce(other, change)) return false;
      OrientedBox place = BoxOf(other);
      place.size_m.z() *= 3;  // upright: along z
      return place.Contains(center_map);
    });
    if (whole == joined.end()) {
      joined.push_back(std::move(change));
      continue;
    }
    Unite(whole->points_before, change.points_before);
    Unite(whole->points_after, change.points_after);
    Unite(whole->sessions, change.sessions);
  }
  return joined;
}

StatusOr<std::vector<ChangeRecord>> PairMoved(MapReader& reader, std::vector<ChangeRecord> changes,
                                              const PairingOptions& options) {
  std::vector<std::vector<PointRecord>> points;
  for (const ChangeRecord& change : changes) {
    MAPP_ASSIGN_OR_RETURN(
        std::vector<PointRecord> found,
        reader.FindPoints(change.kind == ChangeKind::kVanished ? change.points_before : change.points_after));
    points.push_back(std::move(found));
  }
  std::vector<std::tuple<double, size_t, size_t>> pairs;  // share of points alike, vanished, appeared
  for (size_t i = 0; i < changes.size(); ++i) {
    for (size_t k = 0; k < changes.size(); ++k) {
      if (changes[i].kind != ChangeKind::kVanished || changes[k].kind != ChangeKind::kAppeared) continue;
      if (!MayBeAtOnce(changes[i], changes[k])) continue;
      const size_t num_alike = CountAlike(points[i], points[k], options.max_distance_bits);
      const double share = static_cast<double>(num_alike) / static_cast<double>(points[k].size());
      if (num_alike >= options.min_points && share >= options.min_share) pairs.emplace_back(share, i, k);
    }
  }
  std::ranges::sort(pairs, [](const auto& a, const auto& b) {
    return std::get<0>(a) != std::get<0>(b) ? std::get<0>(a) > std::get<0>(b) : a < b;
  });
  std::vector<bool> is_used(changes.size(), false), is_gone(changes.size(), false);
  for (const auto& [share, vanished, appeared] : pairs) {
    if (is_used[vanished] || is_used[appeared]) continue;
    is_used[vanished] = is_used[appeared] = is_gone[appeared] = true;
    Join(changes[vanished], std::move(changes[appeared]));
  }
  std::vector<ChangeRecord> paired;
  for (size_t i = 0; i < changes.size(); ++i) {
    if (!is_gone[i]) paired.push_back(std::move(changes[i]));
  }
  return paired;
}

}  // namespace mapp
