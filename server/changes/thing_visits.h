#pragma once

#include "server/changes/presence.h"
#include "server/changes/session_findings.h"
#include "server/changes/thing_sighting.h"

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <vector>

namespace mapp {

/// A thing's points as they are in the map.
struct ThingPoints {
  std::vector<Eigen::Vector3f> p_map;
  std::vector<Eigen::Vector3f> directions;  ///< unit, mean of (point - camera centre)

  Aabb BoxMap() const;
};

struct ThingVisitOptions {
  /// A session is asked about a thing when it has judged so many of its points, and this share of them.
  double min_judged_points = 4;
  double min_judged_share = 0.15;
  /// Sessions asked on either side of an event: a map of years has many that say the same.
  size_t max_sessions_a_side = 8;
  /// Views of a session that are asked, the nearest first.
  size_t max_views = 16;
  /// Views of one session see the same things again: all of them together count as so many.
  double independent_views = 2;
  /// A thing that is there brings about this share at least of the own points, for its size in the image, that it did
  /// in the visit that saw it best.
  double least_density_share = 0.7;
  /// Where a session has judged this share of the thing's points, or so many, what it says of them counts as well, a
  /// point as so many rays: rays go wrong where something stands close behind, points where surfaces are seen at a flat
  /// angle.
  double telling_share = 0.2;
  double telling_points = 40;
  double point_weight = 0.25;
};

/// What one session says of a thing.
struct ThingVisit {
  SessionId session;
  PresenceEvidence evidence;
  bool was_passed = false;  ///< more rays went on beyond the thing than ended at it
};

/// How many of a thing's points a session saw and missed.
struct PointCounts {
  size_t num_seen = 0, num_missed = 0;
  double num_judged() const { return static_cast<double>(num_seen + num_missed); }
};

/// A session that has judged enough of a thing to be asked.
struct TellingSession {
  SessionId session;
  int64_t opened_ns = 0;
  PointCounts counts;
  bool has_views = true;  ///< false: a device that uploads nothing here, and tells of a sample of points
};

/// Of the sessions that judged some of the thing's points (`counts`) those in `opened_ns` that judged enough, by when
/// they were opened. `reporting`: sessions whose devices have reported points (device_evidence.h), with or without
/// views of the thing.
StatusOr<std::vector<TellingSession>> TellingSessions(const ThingPoints& points,
                                                      const std::map<SessionId, PointCounts>& counts,
                                                      const std::map<SessionId, int64_t>& opened_ns,
                                                      const std::set<SessionId>& reporting, FindingsMaker& maker,
                                                      const ThingVisitOptions& options);

/// What their points say alone.
std::vector<ThingVisit> VisitsByPoints(std::span<const TellingSession> telling, const ThingVisitOptions& options);

/// Asks the views of the sessions nearest to the event, before it and from it on, where their rays ended; of the others
/// and of those without views points tell. By when they were opened.
///
/// Missed is what went on beyond the thing, or, where nothing lies beyond that can be measured, what should have been
/// measured of the thing and was not. Partial frames without a raster do not tell of either. Visits whose points say
/// the opposite are left out.
StatusOr<std::vector<ThingVisit>> VisitsOfThing(const ThingPoints& points, std::span<const TellingSession> telling,
                                                int64_t event_ns, FindingsMaker& maker,
                                                const ThingVisitOptions& options);

}  // namespace mapp
