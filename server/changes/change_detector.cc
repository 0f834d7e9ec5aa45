#include "server/changes/change_detector.h"

#include "server/changes/changed_part.h"
#include "server/changes/place_check.h"
#include "server/changes/thing_course.h"
#include "server/changes/upright_box.h"
#include "storage/map_store.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

namespace mapp {
namespace {

using OpenedTimes = std::map<SessionId, int64_t>;
using DeviceNames = std::map<SessionId, std::string>;

/// Points of the map that came or went, in matching order.
struct ChangingPoints {
  std::vector<PointHistory> histories;
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map;
  std::vector<Eigen::Vector3f> directions;
};

StatusOr<ChangingPoints> FindChangingPoints(MapReader& reader, std::span<const SessionFindings> findings) {
  std::vector<std::pair<PointHistory, PointCourse>> changing;
  std::vector<MapPointId> ids;
  for (PointHistory& history : HistoriesOfMissed(findings)) {
    std::optional<PointCourse> course = CourseOf(history);
    if (!course) continue;
    ids.push_back(history.point);
    changing.emplace_back(std::move(history), *std::move(course));
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> records, reader.FindPoints(ids));
  std::map<MapPointId, const PointRecord*> live;
  for (const PointRecord& record : records) {
    if (record.in_map) live.emplace(record.id, &record);
  }
  ChangingPoints points;
  for (auto& [history, course] : changing) {
    const auto record = live.find(history.point);
    if (record == live.end()) continue;
    points.courses.push_back(std::move(course));
    points.p_map.push_back(record->second->position.cast<float>());
    points.directions.push_back(record->second->view_direction);
    points.histories.push_back(std::move(history));
  }
  return points;
}

/// Devices that say that the thing is gone without views of it; empty when there are views.
std::set<std::string> TellersWithoutViews(const Happening& happening, std::span<const TellingSession> telling,
                                          const DeviceNames& devices) {
  std::set<std::string> tellers;
  for (const SessionId session : happening.missed_by) {
    if (std::ranges::find(telling, session, &TellingSession::session)->has_views) return {};
    tellers.insert(devices.at(session));
  }
  return tellers;
}

/// What the thing's visits tell together of the event that its points were grouped by. nullopt: nothing, or too
/// unsurely, or of something that did not stand still.
StatusOr<std::optional<ChangedPart>> JudgeThing(const ChangedThing& thing, const ChangingPoints& changing,
                                                const GroupingOptions& grouping, const OpenedTimes& opened_ns,
                                                const DeviceNames& devices, FindingsMaker& maker,
                                                const DerivationOptions& options) {
  const auto event_opened = opened_ns.find(thing.event.session);
  if (event_opened == opened_ns.end()) return std::nullopt;
  ThingPoints points;
  std::vector<const PointHistory*> histories;
  ChangedPart part;
  part.group = thing.group;
  for (const size_t i : thing.points) {
    points.p_map.push_back(changing.p_map[i]);
    points.directions.push_back(changing.directions[i]);
    histories.push_back(&changing.histories[i]);
    part.points.push_back({changing.histories[i].point, changing.p_map[i], changing.directions[i]});
  }
  const ChangeKind kind = thing.event.came ? ChangeKind::kAppeared : ChangeKind::kVanished;
  MAPP_ASSIGN_OR_RETURN(const std::vector<TellingSession> telling,
                        TellingSessions(points, histories, opened_ns, grouping.sampled, maker, options.visits));
  // Views are read only where points tell of something.
  if (!HappeningAt(VisitsByPoints(telling, options.visits), kind, event_opened->second, options.presence)) {
    return std::nullopt;
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<ThingVisit> visits,
                        VisitsOfThing(points, telling, event_opened->second, maker, options.visits));
  std::optional<Happening> happening = HappeningAt(visits, kind, event_opened->second, options.presence);
  if (!happening || happening->confidence < options.min_confidence) return std::nullopt;
  const std::set<std::string> without_views = TellersWithoutViews(*happening, telling, devices);
  // One device that is wrong must not retire what others have confirmed.
  if (happening->kind == ChangeKind::kVanished && without_views.size() == 1) return std::nullopt;
  part.is_sampled = !without_views.empty();
  MAPP_ASSIGN_OR_RETURN(const bool is_standing, IsStanding(points, happening->seen_by, maker, options.stay));
  if (!is_standing) return std::nullopt;
  part.happening = *std::move(happening);
  return part;
}

/// Of the boxes that the whole thing may fill, the one with the fewest points that stayed for those that changed with
/// it: what stands beside it is no part of it.
StatusOr<OrientedBox> WholeBox(const OrientedBox& seen_box, const Eigen::Vector3d& view_map, const PlaceCheck& places,
                               const Happening& happening) {
  OrientedBox whole = seen_box;
  std::optional<double> least;
  for (const OrientedBox& box : WithHiddenPart(seen_box, view_map)) {
    MAPP_ASSIGN_OR_RETURN(const PlaceCount count, places.Count(box, 0, happening.time));
    const size_t num_changed = happening.kind == ChangeKind::kVanished ? count.gone.size() : count.num_came;
    const double share = static_cast<double>(count.num_stayed) / static_cast<double>(num_changed + 1);
    if (least && share >= *least) continue;
    least = share;
    whole = box;
  }
  return whole;
}

ChangeRecord RecordOf(const Happening& happening) {
  ChangeRecord change;
  change.kind = happening.kind;
  change.confidence = happening.confidence;
  change.after_ns = happening.time.after_ns;
  change.before_ns = happening.time.before_ns;
  change.first_seen_ns = happening.first_seen_ns;
  change.last_seen_ns = happening.last_seen_ns;
  change.sessions = happening.sessions;
  return change;
}

/// The change with its box and points. nullopt: too little tells of it, or most of what the map has at the place stayed
/// there, so that the thing is a part of a surface that views do not agree on.
StatusOr<std::optional<FoundChange>> Finish(const ChangedPart& part, const Eigen::Vector3d& up_map,
                                            const PlaceCheck& places, const DerivationOptions& options) {
  if (!part.is_sampled && part.points.size() < options.min_points) return std::nullopt;
  std::vector<Eigen::Vector3f> positions;
  std::vector<MapPointId> ids;
  Eigen::Vector3d view_map = Eigen::Vector3d::Zero();
  for (const ChangedPart::Point& point : part.points) {
    ids.push_back(point.id);
    positions.push_back(point.p_map);
    view_map += point.direction.cast<double>() / static_cast<double>(part.points.size());
  }
  const OrientedBox seen_box = UprightBox(positions, up_map, options.stray_share, options.min_side_m);
  if (seen_box.size_m.z() < options.min_height_m) return std::nullopt;
  const EventTime& time = part.happening.time;
  MAPP_ASSIGN_OR_RETURN(const PlaceCount of_seen, places.Count(seen_box, options.place_margin_m, time));
  const auto num_stayed = static_cast<double>(of_seen.num_stayed);
  if (num_stayed > options.max_stayed_share * (num_stayed + static_cast<double>(ids.size()))) return std::nullopt;
  MAPP_ASSIGN_OR_RETURN(const OrientedBox box, WholeBox(seen_box, view_map, places, part.happening));
  FoundChange found{RecordOf(part.happening), seen_box};
  if (part.happening.kind != ChangeKind::kVanished) {
    found.change.box_after = box;
    found.change.points_after = std::move(ids);
    return found;
  }
  found.change.box_before = box;
  // What else was there has gone with it, though no view has looked through it since.
  MAPP_ASSIGN_OR_RETURN(const PlaceCount of_all, places.Count(box, options.place_margin_m, time));
  std::ranges::set_union(ids, of_all.gone, std::back_inserter(found.change.points_before));
  return found;
}

}  // namespace

StatusOr<std::vector<ChangeRecord>> DeriveChanges(MapReader& reader, MapId map, std::span<const SessionRecord> sessions,
                                                  std::span<const FrameRecord> frames,
                                                  std::span<const SessionFindings> findings, FindingsMaker& maker,
                                                  const DerivationOptions& options) {
  OpenedTimes opened_ns;
  DeviceNames devices;
  for (const SessionRecord& session : sessions) {
    devices.emplace(session.id, session.device);
    if (session.opened_ns >= options.from_ns && session.opened_ns <= options.to_ns) {
      opened_ns.emplace(session.id, session.opened_ns);
    }
  }
  MAPP_ASSIGN_OR_RETURN(const ChangingPoints changing, FindChangingPoints(reader, findings));
  const Eigen::Vector3d up_map = UpDirection(frames);
  GroupingOptions grouping = options.grouping;
  for (const SessionFindings& of_session : findings) {
    if (of_session.has_evidence) grouping.sampled.insert(of_session.session);
  }
  std::vector<ChangedPart> parts;
  for (const ChangedThing& thing : GroupThings(changing.courses, changing.p_map, up_map.cast<float>(), grouping)) {
    MAPP_ASSIGN_OR_RETURN(std::optional<ChangedPart> part,
                          JudgeThing(thing, changing, grouping, opened_ns, devices, maker, options));
    if (part) parts.push_back(*std::move(part));
  }
  std::vector<FoundChange> found;
  const PlaceCheck places(maker, findings, opened_ns);
  for (const ChangedPart& part : JoinParts(std::move(parts), options.max_part_gap_m)) {
    MAPP_ASSIGN_OR_RETURN(std::optional<FoundChange> one, Finish(part, up_map, places, options));
    if (one) found.push_back(*std::move(one));
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeRecord> changes,
                        PairMoved(reader, JoinInside(std::move(found)), options.pairing));
  for (ChangeRecord& change : changes) change.map = map;
  std::ranges::sort(changes, {}, [](const ChangeRecord& change) {
    return std::tie(change.before_ns, change.after_ns, change.points_before, change.points_after);
  });
  return changes;
}

}  // namespace mapp
