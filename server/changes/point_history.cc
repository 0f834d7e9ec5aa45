#include "server/changes/point_history.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// So many views that see a place taken are no chance, even of one visit between others that saw it free.
constexpr uint16_t kSureViews = 3;
/// A point that comes and goes more often is one that views do not agree on.
constexpr size_t kMaxSwitches = 4;

/// Calls `visit(SessionId, std::span<const PointFinding>)` for every list of findings, each by ascending id.
template <typename Visit>
void ForEachList(std::span<const SessionFindings> findings, const Visit& visit) {
  for (const SessionFindings& of_session : findings) {
    visit(of_session.session, std::span<const PointFinding>(of_session.own));
    for (const auto& [session, found] : of_session.earlier) visit(session, std::span<const PointFinding>(found));
  }
}

}  // namespace

std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings) {
  std::vector<MapPointId> missed;
  ForEachList(findings, [&](SessionId session, std::span<const PointFinding> list) {
    for (const PointFinding& one : list) {
      if (PointHistory::Visit{session, one.num_seen, one.num_missed}.missed()) missed.push_back(one.point);
    }
  });
  std::ranges::sort(missed);
  const auto twice = std::ranges::unique(missed);
  missed.erase(twice.begin(), twice.end());
  std::vector<PointHistory> histories(missed.size());
  for (size_t i = 0; i < missed.size(); ++i) histories[i].point = missed[i];
  // Millions of findings: both are in order.
  ForEachList(findings, [&](SessionId session, std::span<const PointFinding> list) {
    auto history = histories.begin();
    for (const PointFinding& one : list) {
      while (history != histories.end() && history->point < one.point) ++history;
      if (history == histories.end()) break;
      if (history->point == one.point) history->visits.push_back({session, one.num_seen, one.num_missed});
    }
  });
  for (PointHistory& history : histories) std::ranges::stable_sort(history.visits, {}, &PointHistory::Visit::session);
  return histories;
}

std::optional<PointCourse> CourseOf(const PointHistory& history) {
  std::vector<const PointHistory::Visit*> decided;
  for (const PointHistory::Visit& visit : history.visits) {
    if (visit.seen() || visit.missed()) decided.push_back(&visit);
  }
  PointCourse course;
  for (size_t i = 0; i < decided.size(); ++i) {
    const PointHistory::Visit& visit = *decided[i];
    const bool is_alone = i > 0 && i + 1 < decided.size() && decided[i - 1]->missed() && decided[i + 1]->missed();
    const bool is_there = visit.seen() && !(is_alone && visit.num_seen < kSureViews);
    course.visits.push_back({visit.session, is_there});
  }
  size_t num_switches = 0, num_there = 0;
  for (size_t i = 0; i < course.visits.size(); ++i) {
    num_there += course.visits[i].is_there ? 1 : 0;
    if (i > 0 && course.visits[i].is_there != course.visits[i - 1].is_there) ++num_switches;
  }
  if (num_switches == 0 || num_switches > kMaxSwitches) return std::nullopt;
  const bool passed = num_there == 1 && !course.visits.front().is_there && !course.visits.back().is_there;
  return passed ? std::nullopt : std::optional(std::move(course));
}

}  // namespace mapp
