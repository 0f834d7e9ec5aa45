#include "server/changes/session_findings.h"

#include "storage/map_store.h"

#include <algorithm>
#include <memory>
#include <set>
#include <utility>

namespace mapp {
namespace {

/// What refinement moves a frame by changes nothing that is judged: a fraction of the match radius at a metre's depth.
constexpr double kStillM = 0.03;
constexpr double kStillRad = 0.01;

}  // namespace

bool SessionFindings::RestsOn(std::span<const FrameRecord> frames_of_session) const {
  return std::equal(frames.begin(), frames.end(), frames_of_session.begin(), frames_of_session.end(),
                    [](const WitnessFrame& witness, const FrameRecord& frame) {
                      return witness.frame == frame.id &&
                             Distance(witness.T_map_camera, frame.T_frame_camera) < kStillM &&
                             RotationAngle(witness.T_map_camera, frame.T_frame_camera) < kStillRad;
                    });
}

FindingsMaker::FindingsMaker(MapReader& reader, const MapRecord& map, std::span<const SessionRecord> sessions,
                             std::span<const FrameRecord> frames, const FindingsOptions& options)
    : options_(options),
      range_m_(map.cone_range_m),
      views_(reader, map, options.max_kept_views),
      tiles_(reader, map, frames, options.max_kept_points) {
  for (const SessionRecord& session : sessions) sessions_[session.id].record = session;
  for (const FrameRecord& frame : frames) sessions_[frame.session].frames.push_back(frame);
}

std::span<const FrameRecord> FindingsMaker::FramesOf(SessionId session) const {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return {};
  return found->second.frames;
}

StatusOr<SessionFindings> FindingsMaker::Make(const CallContext& context, SessionId session) {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return absl::NotFoundError("no such session in the map");
  SessionFindings findings{.session = session, .frames = {}, .own = {}, .earlier = {}};
  for (const FrameRecord& frame : found->second.frames) findings.frames.push_back({frame.id, frame.T_frame_camera});
  PointJudge judge(options_.judge, [&](const SightedPoint& point) { return point.founder <= session; });
  MAPP_ASSIGN_OR_RETURN(const NewPoints new_points, Judge(context, found->second, judge));
  findings.own = judge.Conclude();
  MAPP_RETURN_IF_ERROR(AskEarlier(context, new_points, findings));
  return findings;
}

StatusOr<FindingsMaker::NewPoints> FindingsMaker::Judge(const CallContext& context, const Session& session,
                                                        PointJudge& judge) {
  NewPoints new_points;
  std::set<const void*> seen_tiles;
  for (const FrameRecord& frame : session.frames) {
    MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(const std::shared_ptr<const WitnessView> view, views_.Get(frame, session.record));
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointTiles::Points> tiles, tiles_.InBox(view->box_map));
    judge.Add(*view, tiles);
    for (const PointTiles::Points& tile : tiles) {
      if (!seen_tiles.insert(tile.get()).second) continue;
      auto founded = std::make_shared<std::vector<SightedPoint>>();
      std::copy_if(tile->begin(), tile->end(), std::back_inserter(*founded),
                   [&](const SightedPoint& point) { return point.founder == session.record.id; });
      if (!founded->empty()) new_points.push_back(std::move(founded));
    }
  }
  return new_points;
}

Status FindingsMaker::AskEarlier(const CallContext& context, const NewPoints& new_points, SessionFindings& findings) {
  std::map<SessionId, PointJudge> judges;
  for (const PointTiles::Points& points : new_points) {
    MAPP_RETURN_IF_ERROR(context.Check());
    Aabb box_map;
    for (const SightedPoint& point : *points) box_map.extend(point.p_map.cast<double>());
    size_t num_asked = 0;
    for (auto earlier = std::make_reverse_iterator(sessions_.find(findings.session)); earlier != sessions_.rend();
         ++earlier) {
      if (num_asked == options_.max_earlier_sessions) break;
      MAPP_ASSIGN_OR_RETURN(const auto views, ViewsInto(earlier->first, box_map, options_.max_earlier_views));
      if (views.empty()) continue;
      ++num_asked;
      PointJudge& judge =
          judges.try_emplace(earlier->first, options_.judge, [](const SightedPoint&) { return true; }).first->second;
      for (const auto& view : views) judge.Add(*view, std::span(&points, 1));
    }
  }
  for (const auto& [session, judge] : judges) {
    std::vector<PointFinding> found = judge.Conclude();
    if (!found.empty()) findings.earlier.emplace(session, std::move(found));
  }
  return absl::OkStatus();
}

StatusOr<std::vector<std::shared_ptr<const WitnessView>>> FindingsMaker::ViewsInto(SessionId session,
                                                                                   const Aabb& box_map,
                                                                                   size_t max_views) {
  std::vector<std::shared_ptr<const WitnessView>> views;
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return views;
  std::vector<std::pair<double, const FrameRecord*>> near;
  for (const FrameRecord& frame : found->second.frames) {
    const double squared_m2 = box_map.squaredExteriorDistance(frame.T_frame_camera.translation());
    if (squared_m2 < range_m_ * range_m_) near.emplace_back(squared_m2, &frame);
  }
  std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : a.second->id < b.second->id;
  });
  for (const auto& [squared_m2, frame] : near) {
    if (views.size() == max_views) break;
    MAPP_ASSIGN_OR_RETURN(std::shared_ptr<const WitnessView> view, views_.Get(*frame, found->second.record));
    if (view->box_map.intersects(box_map)) views.push_back(std::move(view));
  }
  return views;
}

}  // namespace mapp
