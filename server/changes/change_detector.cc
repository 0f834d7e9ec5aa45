#include "server/changes/change_detector.h"

#include "server/changes/place_check.h"
#include "server/changes/thing_groups.h"
#include "server/changes/thing_visits.h"
#include "server/changes/upright_box.h"
#include "storage/map_store.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

namespace mapp {
namespace {

/// Visits whose posterior leaves more doubt of the state than this do not bound the time of a change.
constexpr double kSureDoubt = 0.05;

/// Something that happened to a thing.
struct Happening {
  ChangeRecord change;
  EventTime time;
  std::vector<SessionId> seen_by;  ///< sessions that saw it there, the nearest to the time first
};

/// What a thing's points tell together, visit by visit.
class ThingCourse {
 public:
  ThingCourse(std::vector<ThingVisit> visits, const DerivationOptions& options)
      : options_(options), visits_(std::move(visits)) {}

  /// Everything that happened to it; boxes and points are left to the caller.
  std::vector<Happening> Happenings() const {
    std::vector<PresenceEvidence> evidence;
    for (const auto& one : visits_) evidence.push_back(one.evidence);
    const PresencePosterior posterior = InferPresence(evidence, options_.presence);
    std::vector<Happening> happenings;
    for (size_t i = 0; i + 1 < visits_.size(); ++i) {
      if (posterior.likely[i] == posterior.likely[i + 1]) continue;
      const bool vanished = posterior.likely[i];
      const auto [first, last] = StayAround(posterior, vanished ? i : i + 1);
      // Seen once and gone: somebody passed, or something stood there for a moment. What stood there before has come back.
      if (first == last && first > 0 && last + 1 < visits_.size() && !HasOtherStay(posterior, first)) continue;
      Happening& one = happenings.emplace_back();
      one.seen_by = SeenBy(posterior, i);
      ChangeRecord& change = one.change;
      change.kind = vanished ? ChangeKind::kVanished : ChangeKind::kAppeared;
      // From the last visit that is sure of the state before to the first that is sure of the one after.
      const auto doubt = [&](size_t k) {
        return posterior.likely[k] ? 1 - posterior.present[k] : posterior.present[k];
      };
      const auto [before_first, before_last] = StayAround(posterior, i);
      const auto [after_first, after_last] = StayAround(posterior, i + 1);
      size_t after = i, before = i + 1;
      while (after > before_first && doubt(after) > kSureDoubt) --after;
      while (before < after_last && doubt(before) > kSureDoubt) ++before;
      change.confidence = std::max(0.0, 1 - doubt(after) - doubt(before));
      change.after_ns = visits_[after].evidence.time_ns;
      change.before_ns = visits_[before].evidence.time_ns;
      change.first_seen_ns = visits_[first].evidence.time_ns;
      change.last_seen_ns = visits_[last].evidence.time_ns;
      const auto [other_first, other_last] = StayAround(posterior, vanished ? i + 1 : i);
      const size_t begin = std::min(first, other_first), end = std::max(last, other_last);
      for (size_t k = begin; k <= end; ++k) change.sessions.push_back(visits_[k].session);
      one.time = {visits_[begin].evidence.time_ns, change.after_ns, change.before_ns, visits_[end].evidence.time_ns};
      std::ranges::sort(change.sessions);
      if (change.confidence < options_.min_confidence) happenings.pop_back();
    }
    return happenings;
  }

 private:
  /// First and last visit of the unbroken stay (or absence) that visit i belongs to.
  static std::pair<size_t, size_t> StayAround(const PresencePosterior& posterior, size_t i) {
    size_t first = i, last = i;
    while (first > 0 && posterior.likely[first - 1] == posterior.likely[i]) --first;
    while (last + 1 < posterior.likely.size() && posterior.likely[last + 1] == posterior.likely[i]) ++last;
    return {first, last};
  }

  /// Whether it was there for two visits or more, apart from visit i.
  static bool HasOtherStay(const PresencePosterior& posterior, size_t i) {
    for (size_t k = 0; k + 1 < posterior.likely.size(); ++k) {
      if (k != i && k + 1 != i && posterior.likely[k] && posterior.likely[k + 1]) return true;
    }
    return false;
  }

  /// Sessions that saw it there, nearest to the change from visit i to the next first.
  std::vector<SessionId> SeenBy(const PresencePosterior& posterior, size_t i) const {
    std::vector<SessionId> sessions;
    for (size_t distance = 0; distance < visits_.size(); ++distance) {
      if (distance <= i && posterior.likely[i - distance]) sessions.push_back(visits_[i - distance].session);
      const size_t after = i + 1 + distance;
      if (after < visits_.size() && posterior.likely[after]) sessions.push_back(visits_[after].session);
    }
    return sessions;
  }

  const DerivationOptions& options_;
  std::vector<ThingVisit> visits_;
};

struct PartPoint {
  MapPointId id;
  Eigen::Vector3f p_map;
  Eigen::Vector3f direction;
};

/// A change with the positions that its box is drawn around.
struct Part {
  ChangeRecord change;
  EventTime time;
  size_t group = 0;
  std::vector<PartPoint> points;
};

bool HappenedTogether(const ChangeRecord& a, const ChangeRecord& b) {
  return a.kind == b.kind && std::max(a.after_ns, b.after_ns) < std::min(a.before_ns, b.before_ns);
}

double GapBetween(const Part& a, const Part& b) {
  double least_m2 = std::numeric_limits<double>::infinity();
  for (const PartPoint& p : a.points) {
    for (const PartPoint& q : b.points) least_m2 = std::min<double>(least_m2, (p.p_map - q.p_map).squaredNorm());
  }
  return std::sqrt(least_m2);
}

void Absorb(Part& into, Part&& part) {
  ChangeRecord& change = into.change;
  change.after_ns = std::max(change.after_ns, part.change.after_ns);
  change.before_ns = std::min(change.before_ns, part.change.before_ns);
  change.first_seen_ns = std::min(change.first_seen_ns, part.change.first_seen_ns);
  change.last_seen_ns = std::max(change.last_seen_ns, part.change.last_seen_ns);
  change.confidence = std::max(change.confidence, part.change.confidence);
  std::vector<SessionId> sessions;
  std::ranges::set_union(change.sessions, part.change.sessions, std::back_inserter(sessions));
  change.sessions = std::move(sessions);
  into.time = {std::max(into.time.since_ns, part.time.since_ns), change.after_ns, change.before_ns,
               std::min(into.time.until_ns, part.time.until_ns)};
  into.points.insert(into.points.end(), part.points.begin(), part.points.end());
}

/// One thing may have been seen in parts that no session has judged together.
std::vector<Part> JoinParts(std::vector<Part> parts, double max_gap_m) {
  for (size_t i = 0; i < parts.size(); ++i) {
    for (size_t k = i + 1; k < parts.size();) {
      if (parts[i].group != parts[k].group && HappenedTogether(parts[i].change, parts[k].change) &&
          GapBetween(parts[i], parts[k]) <= max_gap_m) {
        Absorb(parts[i], std::move(parts[k]));
        parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(k));
        k = i + 1;  // it has grown
      } else {
        ++k;
      }
    }
  }
  return parts;
}

/// Of the boxes that the whole thing may fill, the one that holds the fewest points which stayed: what stands beside it
/// is no part of it.
StatusOr<OrientedBox> WholeBox(const OrientedBox& seen_box, const Eigen::Vector3d& view_map, const PlaceCheck& places,
                               const EventTime& time) {
  OrientedBox whole = seen_box;
  size_t fewest = std::numeric_limits<size_t>::max();
  for (const OrientedBox& box : WithHiddenPart(seen_box, view_map)) {
    MAPP_ASSIGN_OR_RETURN(const PlaceCount count, places.Count(box, 0, time));
    if (count.num_stayed >= fewest) continue;
    fewest = count.num_stayed;
    whole = box;
  }
  return whole;
}

/// The change with its box and points. nullopt: most of what the map has at the place stayed there, so that the thing
/// is a part of a surface that views do not agree on.
StatusOr<std::optional<ChangeRecord>> Finish(Part part, const Eigen::Vector3d& up_map, const PlaceCheck& places,
                                             const DerivationOptions& options) {
  std::vector<Eigen::Vector3f> positions;
  std::vector<MapPointId> ids;
  std::ranges::sort(part.points, {}, &PartPoint::id);
  // Parts that were joined may share points: where it cannot be told when they went, they are of two events.
  const auto twice = std::ranges::unique(part.points, {}, &PartPoint::id);
  part.points.erase(twice.begin(), twice.end());
  Eigen::Vector3d view_map = Eigen::Vector3d::Zero();
  for (const PartPoint& point : part.points) {
    ids.push_back(point.id);
    positions.push_back(point.p_map);
    view_map += point.direction.cast<double>() / static_cast<double>(part.points.size());
  }
  ChangeRecord change = std::move(part.change);
  const OrientedBox seen_box = UprightBox(positions, up_map, options.stray_share, options.min_side_m);
  if (std::getenv("DEBUG_STAY")) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const auto& p : positions) mean += p.cast<double>() / static_cast<double>(positions.size());
    Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();
    for (const auto& p : positions) cov += (p.cast<double>() - mean) * (p.cast<double>() - mean).transpose() / static_cast<double>(positions.size());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> pca(cov);
    std::fprintf(stderr, "PCA %.2f %.2f %.2f n.d %.2f n.up %.2f |d| %.2f ", std::sqrt(pca.eigenvalues()[0]), std::sqrt(pca.eigenvalues()[1]), std::sqrt(pca.eigenvalues()[2]), std::abs(pca.eigenvectors().col(0).dot(view_map.normalized())), std::abs(pca.eigenvectors().col(0).dot(up_map)), view_map.norm());
    const auto of = places.Count(seen_box, options.place_margin_m, part.time);
    std::fprintf(stderr, "PLACE %s %zu told, %zu stayed, %zu untold, size %.1f %.1f %.1f conf %.2f at %.1f %.1f %.1f\n", change.kind == ChangeKind::kVanished ? "vanished" : "appeared", ids.size(), of->num_stayed, of->untold.size(), seen_box.size_m.x(), seen_box.size_m.y(), seen_box.size_m.z(), change.confidence, seen_box.T_frame_box.translation().x(), seen_box.T_frame_box.translation().y(), seen_box.T_frame_box.translation().z());
  }
  if (ids.size() < options.min_points || seen_box.size_m.z() < options.min_height_m) return std::nullopt;
  MAPP_ASSIGN_OR_RETURN(const PlaceCount of_seen, places.Count(seen_box, options.place_margin_m, part.time));
  const auto num_stayed = static_cast<double>(of_seen.num_stayed);
  if (num_stayed > options.max_stayed_share * (num_stayed + static_cast<double>(ids.size()))) return std::nullopt;
  MAPP_ASSIGN_OR_RETURN(const OrientedBox box, WholeBox(seen_box, view_map, places, part.time));
  if (change.kind != ChangeKind::kVanished) {
    change.box_after = box;
    change.points_after = std::move(ids);
    return change;
  }
  change.box_before = box;
  // What else was there has gone with it, though no view has looked through it since.
  MAPP_ASSIGN_OR_RETURN(const PlaceCount of_all, places.Count(box, options.place_margin_m, part.time));
  std::ranges::set_union(ids, of_all.untold, std::back_inserter(change.points_before));
  return change;
}

}  // namespace

StatusOr<std::vector<ChangeRecord>> DeriveChanges(MapReader& reader, MapId map, std::span<const SessionRecord> sessions,
                                                  std::span<const FrameRecord> frames,
                                                  std::span<const SessionFindings> findings, FindingsMaker& maker,
                                                  const DerivationOptions& options) {
  std::map<SessionId, int64_t> opened_ns;
  for (const SessionRecord& session : sessions) {
    if (session.opened_ns >= options.from_ns && session.opened_ns <= options.to_ns) {
      opened_ns.emplace(session.id, session.opened_ns);
    }
  }
  std::vector<PointHistory> missed = HistoriesOfMissed(findings);
  std::vector<MapPointId> ids;
  for (const PointHistory& history : missed) ids.push_back(history.point);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> records, reader.FindPoints(ids));
  std::map<MapPointId, const PointRecord*> live;
  for (const PointRecord& record : records) {
    if (record.in_map) live.emplace(record.id, &record);
  }
  std::vector<PointHistory> histories;
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map, directions;
  for (PointHistory& history : missed) {
    const auto record = live.find(history.point);
    if (record == live.end()) continue;
    std::optional<PointCourse> course = CourseOf(history);
    if (!course) continue;
    courses.push_back(*std::move(course));
    p_map.push_back(record->second->position.cast<float>());
    directions.push_back(record->second->view_direction);
    histories.push_back(std::move(history));
  }
  const Eigen::Vector3d up_map = UpDirection(frames);
  std::vector<Part> parts;
  for (const ChangedThing& thing : GroupThings(courses, p_map, up_map.cast<float>(), options.grouping)) {
    ThingPoints points;
    std::vector<const PointHistory*> of_thing;
    for (const size_t i : thing.points) {
      points.ids.push_back(histories[i].point);
      points.p_map.push_back(p_map[i]);
      points.directions.push_back(directions[i]);
      of_thing.push_back(&histories[i]);
    }
    MAPP_ASSIGN_OR_RETURN(std::vector<ThingVisit> of_sessions,
                          VisitsOfThing(points, of_thing, opened_ns, maker, options.visits));
    const auto event_opened = opened_ns.find(thing.event.session);
    if (event_opened == opened_ns.end()) continue;
    for (Happening& one : ThingCourse(std::move(of_sessions), options).Happenings()) {
      const ChangeKind kind = thing.event.came ? ChangeKind::kAppeared : ChangeKind::kVanished;
      if (one.change.kind != kind || event_opened->second <= one.change.after_ns || event_opened->second > one.change.before_ns) continue;
      std::vector<double> stays_s;
      for (const SessionId session : one.seen_by) {
        if (stays_s.size() == options.max_stay_sessions) break;
        MAPP_ASSIGN_OR_RETURN(const std::optional<double> stay, StayInView(points, session, maker, options.visits.max_stay_views));
        if (stay) stays_s.push_back(*stay);
      }
      if (std::getenv("DEBUG_STAY")) {
        Eigen::Vector3f m = Eigen::Vector3f::Zero();
        for (const auto& p : points.p_map) m += p / static_cast<float>(points.p_map.size());
        std::fprintf(stderr, "STAY %d", int(one.change.kind));
        for (double stay_s : stays_s) std::fprintf(stderr, " %.1f", stay_s);
        std::fprintf(stderr, ", %zu points at %.1f %.1f %.1f\n", points.p_map.size(), m.x(), m.y(), m.z());
      }
      if (stays_s.empty()) continue;
      std::ranges::nth_element(stays_s, stays_s.begin() + static_cast<std::ptrdiff_t>(stays_s.size() / 2));
      if (stays_s[stays_s.size() / 2] < options.min_stay_of_one_visit_s) continue;
      one.change.map = map;
      Part part{std::move(one.change), one.time, thing.group, {}};
      for (size_t i = 0; i < points.ids.size(); ++i)
        part.points.push_back({points.ids[i], points.p_map[i], points.directions[i]});
      parts.push_back(std::move(part));
    }
  }
  std::vector<ChangeRecord> changes;
  const PlaceCheck places(maker, findings, opened_ns);
  for (Part& part : JoinParts(std::move(parts), options.max_part_gap_m)) {
    MAPP_ASSIGN_OR_RETURN(std::optional<ChangeRecord> change, Finish(std::move(part), up_map, places, options));
    if (change) changes.push_back(*std::move(change));
  }
  MAPP_ASSIGN_OR_RETURN(changes, PairMoved(reader, JoinInside(std::move(changes)), options.pairing));
  std::ranges::stable_sort(changes, {}, &ChangeRecord::before_ns);
  return changes;
}

}  // namespace mapp
