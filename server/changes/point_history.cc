#include "server/changes/point_history.h"

#include "mapp/base/parallel.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace mapp {
namespace {

/// So many views that see a place taken are no chance, even of one visit between others that saw it free.
constexpr uint16_t kSureViews = 3;
/// Visits asked about a change on either side of it, and how often a point may come and go in them: of what does so
/// more often views do not agree.
constexpr size_t kVisitsASide = 12;
constexpr size_t kMaxSwitches = 4;

/// Calls `visit(SessionId, std::span<const PointFinding>)` for every list of findings, each by ascending id.
template <typename Visit>
void ForEachList(std::span<const SessionFindings> findings, const Visit& visit) {
  for (const SessionFindings& of_session : findings) {
    visit(of_session.session, std::span<const PointFinding>(of_session.own));
    for (const auto& [session, found] : of_session.earlier) visit(session, std::span<const PointFinding>(found));
  }
}

/// Ids of the points that any session has missed, ascending.
std::vector<MapPointId> MissedPoints(std::span<const SessionFindings> findings) {
  std::vector<MapPointId> missed;
  ForEachList(findings, [&](SessionId session, std::span<const PointFinding> list) {
    for (const PointFinding& one : list) {
      if (PointHistory::Visit{session, one.num_seen, one.num_missed}.missed()) missed.push_back(one.point);
    }
  });
  std::ranges::sort(missed);
  const auto twice = std::ranges::unique(missed);
  missed.erase(twice.begin(), twice.end());
  return missed;
}

/// What is said of the points, which ascend.
std::vector<PointHistory> HistoriesOf(std::span<const MapPointId> points, std::span<const SessionFindings> findings) {
  std::vector<PointHistory> histories(points.size());
  for (size_t i = 0; i < points.size(); ++i) histories[i].point = points[i];
  if (histories.empty()) return histories;
  // Millions of findings: both are in order.
  ForEachList(findings, [&](SessionId session, std::span<const PointFinding> list) {
    auto history = histories.begin();
    for (auto one = std::ranges::lower_bound(list, history->point, {}, &PointFinding::point); one != list.end();
         ++one) {
      while (history != histories.end() && history->point < one->point) ++history;
      if (history == histories.end()) break;
      if (history->point == one->point) history->visits.push_back({session, one->num_seen, one->num_missed});
    }
  });
  for (PointHistory& history : histories) std::ranges::stable_sort(history.visits, {}, &PointHistory::Visit::session);
  return histories;
}

}  // namespace

std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings) {
  return HistoriesOf(MissedPoints(findings), findings);
}

std::span<const PointCourse::Visit> PointCourse::Around(size_t visit) const {
  const size_t begin = visit + 1 - std::min(visit + 1, kVisitsASide);
  const size_t end = std::min(visits.size(), visit + 1 + kVisitsASide);
  const std::span<const Visit> around = std::span(visits).subspan(begin, end - begin);
  size_t num_switches = 0, num_there = 0;
  for (size_t i = 0; i < around.size(); ++i) {
    num_there += around[i].is_there ? 1 : 0;
    num_switches += i > 0 && around[i].is_there != around[i - 1].is_there ? 1 : 0;
  }
  const bool passed = num_there == 1 && !around.front().is_there && !around.back().is_there;
  return passed || num_switches > kMaxSwitches ? std::span<const Visit>() : around;
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
    course.visits.push_back({visit.session, is_there, visit.seen()});
  }
  for (size_t i = 0; i + 1 < course.visits.size(); ++i) {
    if (course.ChangesAfter(i) && !course.Around(i).empty()) return course;
  }
  return std::nullopt;
}

ChangedCourses CoursesOfMissed(std::span<const SessionFindings> findings, int num_threads) {
  constexpr size_t kAtATime = 16'384;
  const std::vector<MapPointId> missed = MissedPoints(findings);
  std::vector<ChangedCourses> parts((missed.size() + kAtATime - 1) / kAtATime);
  ParallelFor(num_threads, static_cast<int>(parts.size()), [&](int i) {
    const size_t begin = static_cast<size_t>(i) * kAtATime;
    const auto points = std::span(missed).subspan(begin, std::min(kAtATime, missed.size() - begin));
    ChangedCourses& part = parts[static_cast<size_t>(i)];
    for (const PointHistory& history : HistoriesOf(points, findings)) {
      std::optional<PointCourse> course = CourseOf(history);
      if (!course) continue;
      part.points.push_back(history.point);
      part.courses.push_back(*std::move(course));
    }
  });
  ChangedCourses all;
  for (ChangedCourses& part : parts) {
    all.points.insert(all.points.end(), part.points.begin(), part.points.end());
    std::ranges::move(part.courses, std::back_inserter(all.courses));
  }
  return all;
}

}  // namespace mapp
