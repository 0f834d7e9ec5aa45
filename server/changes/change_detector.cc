#include "server/changes/change_detector.h"

#include "mapp/base/parallel.h"
#include "server/changes/changed_part.h"
#include "server/changes/place_check.h"
#include "server/changes/thing_course.h"
#include "server/changes/upright_box.h"
#include "storage/map_store.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

using OpenedTimes = std::map<SessionId, int64_t>;
using DeviceNames = std::map<SessionId, std::string>;

/// Points of the map that came or went, in matching order.
struct ChangingPoints {
  std::vector<MapPointId> ids;
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map;
  std::vector<Eigen::Vector3f> directions;
};

StatusOr<ChangingPoints> FindChangingPoints(MapReader& reader, std::span<const SessionFindings> findings,
                                            int num_threads) {
  auto [ids, courses] = CoursesOfMissed(findings, num_threads);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> records, reader.FindPoints(ids));
  std::unordered_map<MapPointId, const PointRecord*> live;
  for (const PointRecord& record : records) {
    if (record.in_map) live.emplace(record.id, &record);
  }
  ChangingPoints points;
  for (size_t i = 0; i < ids.size(); ++i) {
    const auto record = live.find(ids[i]);
    if (record == live.end()) continue;
    points.ids.push_back(ids[i]);
    points.courses.push_back(std::move(courses[i]));
    points.p_map.push_back(record->second->position.cast<float>());
    points.directions.push_back(record->second->view_direction);
  }
  return points;
}

void Count(std::span<const PointCourse::Visit> visits, std::map<SessionId, PointCounts>& counts) {
  for (const PointCourse::Visit& one : visits) {
    ++(one.was_seen ? counts[one.session].num_seen : counts[one.session].num_missed);
  }
}

/// How many of the thing's points each session saw and missed, of the visits that are asked about its event.
std::map<SessionId, PointCounts> CountAround(const ChangedThing& thing, std::span<const PointCourse> courses) {
  std::map<SessionId, PointCounts> counts;
  for (const auto& [point, visit] : thing.points) Count(courses[point].Around(visit), counts);
  return counts;
}

/// Likewise of all visits.
std::map<SessionId, PointCounts> CountAll(const ChangedThing& thing, std::span<const PointCourse> courses) {
  std::map<SessionId, PointCounts> counts;
  for (const PointChange& one : thing.points) Count(courses[one.point].visits, counts);
  return counts;
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

/// What all things of one derivation are judged by.
struct Judging {
  const OpenedTimes& opened_ns;
  const DeviceNames& devices;
  const GroupingOptions& grouping;
  const DerivationOptions& options;
  FindingsMaker& maker;
  ThingMemory& memory;
};

/// Asks the views of a thing.
StatusOr<ThingVerdict> AskViews(const ThingPoints& points, ChangeKind kind, int64_t event_ns,
                                std::span<const TellingSession> telling, const Judging& judging) {
  const DerivationOptions& options = judging.options;
  MAPP_ASSIGN_OR_RETURN(const std::vector<ThingVisit> visits,
                        VisitsOfThing(points, telling, event_ns, judging.maker, options.visits));
  ThingVerdict verdict;
  std::optional<Happening> happening = HappeningAt(visits, kind, event_ns, options.presence);
  if (!happening || happening->confidence < options.min_confidence) return verdict;
  const std::set<std::string> without_views = TellersWithoutViews(*happening, telling, judging.devices);
  // One device that is wrong must not retire what others have confirmed.
  if (happening->kind == ChangeKind::kVanished && without_views.size() == 1) return verdict;
  MAPP_ASSIGN_OR_RETURN(const bool is_standing, IsStanding(points, happening->seen_by, judging.maker, options.stay));
  if (!is_standing) return verdict;
  verdict.is_sampled = !without_views.empty();
  verdict.happening = std::move(happening);
  return verdict;
}

/// What the thing's visits tell together of the event that its points were grouped by, if they do.
StatusOr<std::optional<ChangedPart>> JudgeThing(const ChangedThing& thing, const ChangingPoints& changing,
                                                const Judging& judging) {
  const auto event_opened = judging.opened_ns.find(thing.event.session);
  if (event_opened == judging.opened_ns.end()) return std::nullopt;
  ThingPoints points;
  std::vector<MapPointId> ids;
  for (const PointChange& one : thing.points) {
    ids.push_back(changing.ids[one.point]);
    points.p_map.push_back(changing.p_map[one.point]);
    points.directions.push_back(changing.directions[one.point]);
  }
  const ChangeKind kind = thing.event.came ? ChangeKind::kAppeared : ChangeKind::kVanished;
  const auto telling_of = [&](const std::map<SessionId, PointCounts>& counts) {
    return TellingSessions(points, counts, judging.opened_ns, judging.grouping.sampled, judging.maker,
                           judging.options.visits);
  };
  MAPP_ASSIGN_OR_RETURN(const std::vector<TellingSession> telling, telling_of(CountAround(thing, changing.courses)));
  // Views are read only where points tell of something.
  if (!HappeningAt(VisitsByPoints(telling, judging.options.visits), kind, event_opened->second,
                   judging.options.presence)) {
    return std::nullopt;
  }
  const ThingQuestion question{thing.event, ids, points.p_map, telling};
  std::optional<ThingVerdict> verdict = judging.memory.Find(question);
  if (!verdict) {
    MAPP_ASSIGN_OR_RETURN(verdict, AskViews(points, kind, event_opened->second, telling, judging));
    judging.memory.Keep(question, *verdict);
  }
  if (!verdict->happening) return std::nullopt;
  MAPP_ASSIGN_OR_RETURN(const std::vector<TellingSession> all, telling_of(CountAll(thing, changing.courses)));
  ExtendStay(VisitsByPoints(all, judging.options.visits), *verdict->happening);
  ChangedPart part{*std::move(verdict->happening), thing.group, verdict->is_sampled, {}};
  for (size_t i = 0; i < ids.size(); ++i) part.points.push_back({ids[i], points.p_map[i], points.directions[i]});
  return part;
}

/// Judges all things. Those of one time ask the same views, and so come after each other.
StatusOr<std::vector<ChangedPart>> JudgeThings(const CallContext& context, std::span<const ChangedThing> things,
                                               const ChangingPoints& changing, const Judging& judging) {
  std::vector<size_t> by_time(things.size());
  std::iota(by_time.begin(), by_time.end(), size_t{0});
  std::ranges::stable_sort(by_time, {}, [&](size_t i) { return things[i].event; });
  std::vector<StatusOr<std::optional<ChangedPart>>> judged(things.size());
  ParallelFor(judging.options.num_threads, static_cast<int>(things.size()), [&](int n) {
    const size_t i = by_time[static_cast<size_t>(n)];
    if (Status status = context.Check(); !status.ok()) {
      judged[i] = std::move(status);
    } else {
      judged[i] = JudgeThing(things[i], changing, judging);
    }
  });
  std::vector<ChangedPart> parts;
  for (StatusOr<std::optional<ChangedPart>>& part : judged) {
    MAPP_RETURN_IF_ERROR(part.status());
    if (*part) parts.push_back(**std::move(part));
  }
  return parts;
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

StatusOr<std::vector<ChangeRecord>> DeriveChanges(const CallContext& context, MapReader& reader, MapId map,
                                                  std::span<const SessionRecord> sessions,
                                                  std::span<const FrameRecord> frames,
                                                  std::span<const SessionFindings> findings, FindingsMaker& maker,
                                                  const DerivationOptions& options, ThingMemory& memory) {
  OpenedTimes opened_ns;
  DeviceNames devices;
  for (const SessionRecord& session : sessions) {
    devices.emplace(session.id, session.device);
    if (session.opened_ns >= options.from_ns && session.opened_ns <= options.to_ns) {
      opened_ns.emplace(session.id, session.opened_ns);
    }
  }
  MAPP_ASSIGN_OR_RETURN(const ChangingPoints changing, FindChangingPoints(reader, findings, options.num_threads));
  const Eigen::Vector3d up_map = UpDirection(frames);
  GroupingOptions grouping = options.grouping;
  grouping.num_threads = options.num_threads;
  for (const SessionFindings& of_session : findings) {
    if (of_session.has_evidence) grouping.sampled.insert(of_session.session);
  }
  const std::vector<ChangedThing> things =
      GroupThings(changing.courses, changing.p_map, up_map.cast<float>(), grouping);
  memory.Begin(findings);
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangedPart> parts,
                        JudgeThings(context, things, changing, {opened_ns, devices, grouping, options, maker, memory}));
  memory.End();
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
