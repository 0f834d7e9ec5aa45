#pragma once

#include "server/changes/session_findings.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// What all sessions say of one point.
struct PointHistory {
  struct Visit {
    SessionId session;
    uint16_t num_seen = 0;
    uint16_t num_missed = 0;
    bool seen() const { return num_seen > num_missed; }
    bool missed() const { return num_missed > 4 * num_seen; }
  };
  MapPointId point;
  std::vector<Visit> visits;  ///< by session
};

/// Of the points that any session has missed, by id: all that sessions tell of the others is that they are there.
std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings);

/// Whether a point was there at each visit that could tell, by session.
struct PointCourse {
  struct Visit {
    SessionId session;
    bool is_there = false;
    bool was_seen = false;  ///< as the visit itself says
  };
  std::vector<Visit> visits;

  bool ChangesAfter(size_t visit) const { return visits[visit].is_there != visits[visit + 1].is_there; }
  /// The visits that are asked about the change after a visit: some before and after it, so that what is said of a time
  /// stays said when the world goes on. Empty where they tell of no thing that stays: one visit alone saw the point and
  /// others before and after did not (somebody passed, or something stood there for a moment), or they do not agree.
  std::span<const Visit> Around(size_t visit) const;
};

/// The history without chance: a visit that sees a surface where those before and after it saw none counts only when
/// several of its views say so, for at flat angles what lies near is taken for the place itself. nullopt where no
/// change tells of anything.
std::optional<PointCourse> CourseOf(const PointHistory& history);

/// Points that came or went, by id.
struct ChangedCourses {
  std::vector<MapPointId> points;
  std::vector<PointCourse> courses;
};
/// Of the histories of all points that any session has missed, which are not in memory together.
ChangedCourses CoursesOfMissed(std::span<const SessionFindings> findings, int num_threads);

}  // namespace mapp
