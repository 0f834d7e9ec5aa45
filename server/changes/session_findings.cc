#include "server/changes/session_findings.h"

#include "mapp/base/parallel.h"
#include "storage/map_store.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <set>
#include <utility>

namespace mapp {
namespace {

/// Calls `work(worker, i)` for i < count until one fails; worker w has every `num_workers`-th i, beginning with w.
template <typename Work>
Status ShareOut(int num_workers, size_t count, const Work& work) {
  std::vector<Status> outcomes(static_cast<size_t>(num_workers));
  ParallelFor(num_workers, num_workers, [&](int worker) {
    Status& outcome = outcomes[static_cast<size_t>(worker)];
    for (size_t i = static_cast<size_t>(worker); i < count && outcome.ok(); i += outcomes.size()) {
      outcome = work(static_cast<size_t>(worker), i);
    }
  });
  for (const Status& outcome : outcomes) MAPP_RETURN_IF_ERROR(outcome);
  return absl::OkStatus();
}

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
      views_(reader, reading_, map, options.max_kept_views),
      tiles_(reader, reading_, map, frames, options.max_kept_points) {
  for (const SessionRecord& session : sessions) sessions_[session.id].record = session;
  for (const FrameRecord& frame : frames) sessions_[frame.session].frames.push_back(frame);
}

std::span<const FrameRecord> FindingsMaker::FramesOf(SessionId session) const {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return {};
  return found->second.frames;
}

StatusOr<SessionFindings> FindingsMaker::Make(const CallContext& context, SessionId session, int num_threads) {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return absl::NotFoundError("no such session in the map");
  SessionFindings findings{.session = session, .frames = {}, .own = {}, .earlier = {}};
  for (const FrameRecord& frame : found->second.frames) findings.frames.push_back({frame.id, frame.T_frame_camera});
  PointJudge judge(options_.judge, session);
  MAPP_ASSIGN_OR_RETURN(const NewPoints new_points, Judge(context, found->second, num_threads, judge));
  findings.own = MergeFindings(judge.Conclude(num_threads));
  MAPP_RETURN_IF_ERROR(AskEarlier(context, new_points, num_threads, findings));
  return findings;
}

StatusOr<FindingsMaker::NewPoints> FindingsMaker::Judge(const CallContext& context, const Session& session,
                                                        int num_threads, PointJudge& judge) {
  struct Worker {
    PointJudge judge;
    std::set<PointTiles::Points> tiles;
  };
  std::vector<Worker> workers(static_cast<size_t>(num_threads), {judge, {}});
  const auto judge_by = [&](size_t worker, size_t i) -> Status {
    MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(const std::shared_ptr<const WitnessView> view, views_.Get(session.frames[i], session.record));
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointTiles::Points> tiles, tiles_.InBox(view->box_map));
    workers[worker].judge.Add(*view, tiles);
    workers[worker].tiles.insert(tiles.begin(), tiles.end());
    return absl::OkStatus();
  };
  MAPP_RETURN_IF_ERROR(ShareOut(num_threads, session.frames.size(), judge_by));
  std::set<PointTiles::Points> tiles;
  for (Worker& worker : workers) {
    judge.Merge(std::move(worker.judge));
    tiles.merge(worker.tiles);
  }
  NewPoints new_points;
  for (const PointTiles::Points& tile : tiles) {
    std::vector<SightedPoint> founded;
    std::ranges::copy_if(tile->points(), std::back_inserter(founded),
                         [&](const SightedPoint& point) { return point.founder == session.record.id; });
    if (!founded.empty()) new_points.push_back(std::make_shared<const SightedTile>(std::move(founded)));
  }
  return new_points;
}

Status FindingsMaker::AskEarlier(const CallContext& context, const NewPoints& new_points, int num_threads,
                                 SessionFindings& findings) {
  std::vector<std::map<SessionId, PointJudge>> judges(static_cast<size_t>(num_threads));
  const auto ask_about = [&](size_t worker, size_t i) -> Status {
    MAPP_RETURN_IF_ERROR(context.Check());
    return AskEarlierAbout(new_points[i], findings.session, judges[worker]);
  };
  MAPP_RETURN_IF_ERROR(ShareOut(num_threads, new_points.size(), ask_about));
  std::map<SessionId, PointJudge> merged;
  for (auto& of_worker : judges) {
    for (auto& [session, judge] : of_worker)
      merged.try_emplace(session, options_.judge).first->second.Merge(std::move(judge));
  }
  for (const auto& [session, judge] : merged) {
    std::vector<PointFinding> found = MergeFindings(judge.Conclude(num_threads));
    if (!found.empty()) findings.earlier.emplace(session, std::move(found));
  }
  return absl::OkStatus();
}

Status FindingsMaker::AskEarlierAbout(const PointTiles::Points& points, SessionId session,
                                      std::map<SessionId, PointJudge>& judges) {
  Aabb box_map;
  for (const SightedPoint& point : points->points()) box_map.extend(point.p_map.cast<double>());
  size_t num_asked = 0;
  for (auto earlier = std::make_reverse_iterator(sessions_.find(session)); earlier != sessions_.rend(); ++earlier) {
    if (num_asked == options_.max_earlier_sessions) break;
    MAPP_ASSIGN_OR_RETURN(const auto views, ViewsInto(earlier->first, box_map, options_.max_earlier_views));
    if (views.empty()) continue;
    ++num_asked;
    PointJudge& judge = judges.try_emplace(earlier->first, options_.judge).first->second;
    for (const auto& view : views) judge.Add(*view, std::span(&points, 1));
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
