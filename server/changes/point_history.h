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
  };
  std::vector<Visit> visits;
};

/// The history without chance: a visit that sees a surface where those before and after it saw none counts only when
/// several of its views say so, for at flat angles what lies near is taken for the place itself. nullopt where it tells
/// of no thing that stays: the point was always there or never, one visit alone saw it and others before and after did
/// not (somebody passed, or something stood there for a moment), or visits do not agree.
std::optional<PointCourse> CourseOf(const PointHistory& history);

}  // namespace mapp
