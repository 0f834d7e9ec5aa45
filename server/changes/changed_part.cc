#include "server/changes/changed_part.h"

#include "mapp/geometry/pose3.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace mapp {
namespace {

bool HappenedTogether(const Happening& a, const Happening& b) {
  return a.kind == b.kind && std::max(a.time.after_ns, b.time.after_ns) < std::min(a.time.before_ns, b.time.before_ns);
}

Aabb BoxAround(const ChangedPart& part) {
  Aabb box_map;
  for (const ChangedPart::Point& point : part.points) box_map.extend(point.p_map.cast<double>());
  return box_map;
}

bool AreNear(const ChangedPart& a, const ChangedPart& b, double max_gap_m) {
  const auto max_squared_m2 = static_cast<float>(max_gap_m * max_gap_m);
  return std::ranges::any_of(a.points, [&](const ChangedPart::Point& p) {
    return std::ranges::any_of(
        b.points, [&](const ChangedPart::Point& q) { return (p.p_map - q.p_map).squaredNorm() <= max_squared_m2; });
  });
}

void Unite(std::vector<SessionId>& into, const std::vector<SessionId>& more) {
  std::vector<SessionId> all;
  std::ranges::set_union(into, more, std::back_inserter(all));
  into = std::move(all);
}

void Absorb(ChangedPart& into, ChangedPart&& part) {
  Happening& happening = into.happening;
  const EventTime& time = part.happening.time;
  happening.time = {std::max(happening.time.since_ns, time.since_ns), std::max(happening.time.after_ns, time.after_ns),
                    std::min(happening.time.before_ns, time.before_ns),
                    std::min(happening.time.until_ns, time.until_ns)};
  happening.first_seen_ns = std::min(happening.first_seen_ns, part.happening.first_seen_ns);
  happening.last_seen_ns = std::max(happening.last_seen_ns, part.happening.last_seen_ns);
  happening.confidence = std::max(happening.confidence, part.happening.confidence);
  Unite(happening.sessions, part.happening.sessions);
  into.points.insert(into.points.end(), part.points.begin(), part.points.end());
}

}  // namespace

std::vector<ChangedPart> JoinParts(std::vector<ChangedPart> parts, double max_gap_m) {
  std::vector<Aabb> boxes_map;
  for (const ChangedPart& part : parts) boxes_map.push_back(BoxAround(part));
  for (size_t i = 0; i < parts.size(); ++i) {
    for (size_t k = i + 1; k < parts.size();) {
      if (parts[i].group != parts[k].group && HappenedTogether(parts[i].happening, parts[k].happening) &&
          boxes_map[i].exteriorDistance(boxes_map[k]) <= max_gap_m && AreNear(parts[i], parts[k], max_gap_m)) {
        Absorb(parts[i], std::move(parts[k]));
        boxes_map[i].extend(boxes_map[k]);
        parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(k));
        boxes_map.erase(boxes_map.begin() + static_cast<std::ptrdiff_t>(k));
        k = i + 1;  // it has grown
      } else {
        ++k;
      }
    }
  }
  for (ChangedPart& part : parts) {
    std::ranges::sort(part.points, {}, &ChangedPart::Point::id);
    const auto twice = std::ranges::unique(part.points, {}, &ChangedPart::Point::id);
    part.points.erase(twice.begin(), twice.end());
  }
  return parts;
}

}  // namespace mapp
