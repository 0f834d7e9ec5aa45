#include "server/changes/point_history.h"

#include <algorithm>
#include <map>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// So many views that see a place taken are no chance, even of one visit between others that saw it free.
constexpr uint16_t kSureViews = 3;
/// A point that comes and goes more often is one that views do not agree on.
constexpr size_t kMaxSwitches = 4;

template <typename Visit>
void ForEachFinding(const SessionFindings& findings, const Visit& visit) {
  for (const PointFinding& finding : findings.own) visit(findings.session, finding);
  for (const auto& [session, found] : findings.earlier) {
    for (const PointFinding& finding : found) visit(session, finding);
  }
}

}  // namespace

std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings) {
  std::unordered_set<MapPointId> missed;
  for (const SessionFindings& of_session : findings) {
    ForEachFinding(of_session, [&](SessionId session, const PointFinding& finding) {
      if (PointHistory::Visit{session, finding.num_seen, finding.num_missed}.missed()) missed.insert(finding.point);
    });
  }
  std::map<MapPointId, PointHistory> histories;
  for (const SessionFindings& of_session : findings) {
    ForEachFinding(of_session, [&](SessionId session, const PointFinding& finding) {
      if (!missed.contains(finding.point)) return;
      PointHistory& history = histories[finding.point];
      history.point = finding.point;
      history.visits.push_back({session, finding.num_seen, finding.num_missed});
    });
  }
  std::vector<PointHistory> result;
  for (auto& [id, history] : histories) {
    std::sort(history.visits.begin(), history.visits.end(),
              [](const auto& a, const auto& b) { return a.session < b.session; });
    result.push_back(std::move(history));
  }
  return result;
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
