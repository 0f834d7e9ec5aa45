#include "server/changes/thing_course.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace mapp {
namespace {

/// Visits whose posterior leaves more doubt of the state than this do not bound the time of a change.
constexpr double kSureDoubt = 0.05;

/// A thing's most probable course through its visits.
class Course {
 public:
  Course(std::span<const ThingVisit> visits, const PresenceOptions& options) : visits_(visits) {
    std::vector<PresenceEvidence> evidence;
    for (const ThingVisit& visit : visits) evidence.push_back(visit.evidence);
    posterior_ = InferPresence(evidence, options);
  }

  bool IsThere(size_t i) const { return posterior_.likely[i]; }

  /// First and last visit of the unbroken stay (or absence) that visit i belongs to.
  std::pair<size_t, size_t> StretchAround(size_t i) const {
    size_t first = i, last = i;
    while (first > 0 && IsThere(first - 1) == IsThere(i)) --first;
    while (last + 1 < visits_.size() && IsThere(last + 1) == IsThere(i)) ++last;
    return {first, last};
  }

  /// Seen once and gone. What was there for two visits at another time has come back, and is none.
  bool IsPasser(const std::pair<size_t, size_t>& stay) const {
    const auto [first, last] = stay;
    if (first != last || first == 0 || last + 1 == visits_.size()) return false;
    for (size_t k = 0; k + 1 < visits_.size(); ++k) {
      if (k != first && k + 1 != first && IsThere(k) && IsThere(k + 1)) return false;
    }
    return true;
  }

  /// Gone for one visit alone, which no rays that went on beyond it confirm: that visit's poses are wrong.
  bool IsSlip(const std::pair<size_t, size_t>& absence) const {
    const auto [first, last] = absence;
    return first == last && first > 0 && last + 1 < visits_.size() && !visits_[first].was_passed;
  }

  /// The change between visits i and i + 1.
  Happening Change(size_t i) const {
    Happening one;
    const auto before = StretchAround(i), after = StretchAround(i + 1);
    one.kind = IsThere(i) ? ChangeKind::kVanished : ChangeKind::kAppeared;
    // From the last visit that is sure of the state before to the first that is sure of the one after.
    size_t last_before = i, first_after = i + 1;
    while (last_before > before.first && Doubt(last_before) > kSureDoubt) --last_before;
    while (first_after < after.second && Doubt(first_after) > kSureDoubt) ++first_after;
    one.confidence = std::max(0.0, 1 - Doubt(last_before) - Doubt(first_after));
    one.time = {TimeOf(before.first), TimeOf(last_before), TimeOf(first_after), TimeOf(after.second)};
    const auto& [there, gone] = IsThere(i) ? std::pair(before, after) : std::pair(after, before);
    one.first_seen_ns = TimeOf(there.first);
    one.last_seen_ns = TimeOf(there.second);
    for (size_t k = before.first; k <= after.second; ++k) one.sessions.push_back(visits_[k].session);
    std::ranges::sort(one.sessions);
    for (size_t k = gone.first; k <= gone.second; ++k) one.missed_by.push_back(visits_[k].session);
    for (size_t distance = 0; distance < visits_.size(); ++distance) {
      if (distance <= i && IsThere(i - distance)) one.seen_by.push_back(visits_[i - distance].session);
      const size_t later = i + 1 + distance;
      if (later < visits_.size() && IsThere(later)) one.seen_by.push_back(visits_[later].session);
    }
    return one;
  }

 private:
  double Doubt(size_t i) const { return IsThere(i) ? 1 - posterior_.present[i] : posterior_.present[i]; }
  int64_t TimeOf(size_t i) const { return visits_[i].evidence.time_ns; }

  std::span<const ThingVisit> visits_;
  PresencePosterior posterior_;
};

}  // namespace

std::optional<Happening> HappeningAt(std::span<const ThingVisit> visits, ChangeKind kind, int64_t event_ns,
                                     const PresenceOptions& options) {
  const Course course(visits, options);
  for (size_t i = 0; i + 1 < visits.size(); ++i) {
    if (course.IsThere(i) == course.IsThere(i + 1)) continue;
    const bool vanished = course.IsThere(i);
    if (course.IsPasser(course.StretchAround(vanished ? i : i + 1))) continue;
    if (course.IsSlip(course.StretchAround(vanished ? i + 1 : i))) continue;
    Happening one = course.Change(i);
    if (one.kind == kind && event_ns > one.time.after_ns && event_ns <= one.time.before_ns) return one;
  }
  return std::nullopt;
}

void ExtendStay(std::span<const ThingVisit> visits, Happening& happening) {
  const auto time_of = [](const ThingVisit& visit) { return visit.evidence.time_ns; };
  const auto missed = [](const ThingVisit& visit) { return visit.evidence.num_missed >= visit.evidence.num_seen; };
  const auto first = std::ranges::lower_bound(visits, happening.first_seen_ns, {}, time_of);
  const auto gone_before = std::find_if(std::make_reverse_iterator(first), visits.rend(), missed);
  if (gone_before.base() != first) happening.first_seen_ns = time_of(*gone_before.base());
  const auto later = std::ranges::upper_bound(visits, happening.last_seen_ns, {}, time_of);
  const auto gone_after = std::find_if(later, visits.end(), missed);
  if (gone_after != later) happening.last_seen_ns = time_of(*std::prev(gone_after));
}

}  // namespace mapp
