#include "server/service/loop_graph.h"

#include "storage/map_store.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <numbers>
#include <set>
#include <utility>

namespace mapp {
namespace {

/// Frames that may move, and the bound of the work; of those beyond, so many are read to stay.
constexpr size_t kMaxFreeFrames = 1000;
constexpr size_t kMaxFixedFrames = 300;
/// Of the frames that a frame shares points with, it is linked with those only that share most.
constexpr size_t kMaxLinksOfFrame = 6;

struct Sigma {
  double least_m;
  double least_rad;
};
/// One sigma between frames that follow each other, of frames that share points, and of a match: what each is off by
/// whatever the distance.
constexpr Sigma kStep = {0.001, 0.02 * std::numbers::pi / 180};
constexpr Sigma kCovisible = {0.01, 0.1 * std::numbers::pi / 180};
constexpr Sigma kMatch = {0.005, 0.1 * std::numbers::pi / 180};
/// What grows with distance and turn, as OdometryLinks has it.
constexpr double kGrowth = 0.02;

BundleProblem::RelativePose MakeLink(int from_idx, int to_idx, const Pose3& T_from_to, const Sigma& sigma) {
  return {.from_idx = from_idx,
          .to_idx = to_idx,
          .T_from_to = T_from_to,
          .sigma_m = sigma.least_m + kGrowth * T_from_to.translation().norm(),
          .sigma_rad = sigma.least_rad + kGrowth * LogSo3(T_from_to.rotation()).norm()};
}

class GraphLoader {
 public:
  GraphLoader(const CallContext& context, MapReader& reader, const Loop& loop)
      : context_(context), reader_(reader), loop_(loop) {}

  StatusOr<LoopGraph> Load();

 private:
  Status Enqueue(FrameId frame);
  /// Reads the next frame waiting, and makes those wait that share points with it.
  Status ReadNext();
  Status FixGauge();
  void Link(int a, int b, const Sigma& sigma);
  void LinkNeighborsInNumber();
  void LinkCovisible();
  void LinkMatches();
  FrameId FirstToSee(const PointRecord& point) const;
  Status RememberSnapshot();
  bool IsFixed(int idx) const { return graph_.region.problem.frames[static_cast<size_t>(idx)].fixed; }

  const CallContext& context_;
  MapReader& reader_;
  const Loop& loop_;
  LoopGraph graph_;
  std::deque<FrameRecord> waiting_;
  std::set<FrameId> met_;
  std::map<FrameId, int> indices_;
  std::map<MapPointId, std::vector<int>> observers_;  ///< of live points: frames, in the order read
  std::map<MapPointId, PointRecord> points_;
  std::set<std::pair<int, int>> linked_;
};

Status GraphLoader::Enqueue(FrameId frame) {
  if (!met_.insert(frame).second) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(FrameRecord record, reader_.GetFrame(frame));
  if (record.in_map) waiting_.push_back(std::move(record));
  return absl::OkStatus();
}

Status GraphLoader::ReadNext() {
  MAPP_RETURN_IF_ERROR(context_.Check());
  FrameRecord frame = std::move(waiting_.front());
  waiting_.pop_front();
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader_.GetObservations(frame.id));
  std::vector<MapPointId> unread;
  for (const Observation& observation : observations) {
    if (!points_.contains(observation.point)) unread.push_back(observation.point);
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, reader_.FindPoints(unread));
  OptimizerRegion& region = graph_.region;
  const bool fixed = region.frames.size() >= kMaxFreeFrames;
  for (PointRecord& point : points) {
    if (!point.in_map) continue;
    if (!fixed) {
      for (const FrameId observer : point.observers) MAPP_RETURN_IF_ERROR(Enqueue(observer));
    }
    const MapPointId id = point.id;
    points_.emplace(id, std::move(point));
  }
  const auto idx = static_cast<int>(region.frames.size());
  for (const Observation& observation : observations) {
    if (points_.contains(observation.point)) observers_[observation.point].push_back(idx);
  }
  indices_.emplace(frame.id, idx);
  region.problem.frames.push_back({.camera = {}, .T_world_camera = frame.T_frame_camera, .fixed = fixed});
  region.frames.push_back(std::move(frame));
  return absl::OkStatus();
}

/// As in an adjustment with observations: the frame that defined the map's stays, or else the earliest one.
Status GraphLoader::FixGauge() {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader_.GetMap(loop_.map));
  OptimizerRegion& region = graph_.region;
  bool has_fixed = false;
  for (size_t i = 0; i < region.frames.size(); ++i) {
    if (region.frames[i].number == 0 && map.founder == region.frames[i].session) region.problem.frames[i].fixed = true;
    has_fixed |= region.problem.frames[i].fixed;
  }
  if (!has_fixed) region.problem.frames[static_cast<size_t>(indices_.begin()->second)].fixed = true;
  return absl::OkStatus();
}

void GraphLoader::Link(int a, int b, const Sigma& sigma) {
  if (a == b || (IsFixed(a) && IsFixed(b)) || !linked_.insert(std::minmax(a, b)).second) return;
  const std::vector<BundleProblem::Frame>& frames = graph_.region.problem.frames;
  const Pose3 T_a_b =
      frames[static_cast<size_t>(a)].T_world_camera.Inverse() * frames[static_cast<size_t>(b)].T_world_camera;
  graph_.region.problem.relative_poses.push_back(MakeLink(a, b, T_a_b, sigma));
}

void GraphLoader::LinkNeighborsInNumber() {
  std::map<std::pair<SessionId, uint32_t>, int> by_number;
  const std::vector<FrameRecord>& frames = graph_.region.frames;
  for (size_t i = 0; i < frames.size(); ++i) {
    by_number.emplace(std::pair(frames[i].session, frames[i].number), static_cast<int>(i));
  }
  const std::pair<const std::pair<SessionId, uint32_t>, int>* previous = nullptr;
  for (const auto& entry : by_number) {
    if (previous != nullptr && previous->first.first == entry.first.first) Link(previous->second, entry.second, kStep);
    previous = &entry;
  }
}

void GraphLoader::LinkCovisible() {
  const std::vector<FrameRecord>& frames = graph_.region.frames;
  std::vector<std::map<int, int>> shared(frames.size());
  for (const auto& [point, observers] : observers_) {
    for (const int a : observers) {
      for (const int b : observers) {
        if (a != b) ++shared[static_cast<size_t>(a)][b];
      }
    }
  }
  for (size_t i = 0; i < frames.size(); ++i) {
    std::vector<std::pair<int, int>> ranked;
    for (const auto& [other, count] : shared[i]) {
      if (count >= kMinJoiningPoints) ranked.emplace_back(-count, other);
    }
    std::ranges::sort(ranked);
    if (ranked.size() > kMaxLinksOfFrame) ranked.resize(kMaxLinksOfFrame);
    for (const auto& [count, other] : ranked) Link(static_cast<int>(i), other, kCovisible);
  }
}

void GraphLoader::LinkMatches() {
  for (const LoopMatch& match : loop_.matches) {
    const auto anchor = indices_.find(match.anchor);
    const auto frame = indices_.find(match.frame);
    if (anchor == indices_.end() || frame == indices_.end()) continue;
    BundleProblem::RelativePose link = MakeLink(anchor->second, frame->second, match.T_anchor_frame, kMatch);
    link.robust = false;
    graph_.region.problem.relative_poses.push_back(link);
    ++graph_.num_matches;
  }
}

/// The frame that mapped the point, or else the earliest one that sees it.
FrameId GraphLoader::FirstToSee(const PointRecord& point) const {
  const FrameRecord* first = nullptr;
  const auto is_later = [&point](const FrameRecord& frame) {
    return std::pair(frame.session != point.session, frame.id);
  };
  for (const int idx : observers_.at(point.id)) {
    const FrameRecord& frame = graph_.region.frames[static_cast<size_t>(idx)];
    if (first == nullptr || is_later(frame) < is_later(*first)) first = &frame;
  }
  return first->id;
}

Status GraphLoader::RememberSnapshot() {
  OptimizerRegion& region = graph_.region;
  std::set<SessionId> sessions;
  for (const FrameRecord& frame : region.frames) sessions.insert(frame.session);
  for (const SessionId session : sessions) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader_.ListFrames(loop_.map, session));
    const FrameRecord* newest = nullptr;
    for (const FrameRecord& frame : frames) {
      if (!frame.in_map) continue;
      region.known_frames.insert(frame.id);
      if (newest == nullptr || frame.number > newest->number) newest = &frame;
    }
    if (newest != nullptr && indices_.contains(newest->id)) region.led_sessions.push_back(session);
  }
  for (auto& [id, point] : points_) {
    region.known_points.insert(id);
    const FrameId frame = FirstToSee(point);
    region.carried_points.push_back({.record = std::move(point), .frame = frame});
  }
  return absl::OkStatus();
}

StatusOr<LoopGraph> GraphLoader::Load() {
  // Within the bound have to be the matches, and then what of the session is nearest to them.
  for (const LoopMatch& match : loop_.matches) {
    MAPP_RETURN_IF_ERROR(Enqueue(match.anchor));
    MAPP_RETURN_IF_ERROR(Enqueue(match.frame));
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> own, reader_.ListFrames(loop_.map, loop_.visit.session));
  std::ranges::stable_sort(own, {}, [this](const FrameRecord& frame) {
    const uint32_t at = loop_.visit.last_number;
    return std::max(frame.number, at) - std::min(frame.number, at);
  });
  for (const FrameRecord& frame : own) MAPP_RETURN_IF_ERROR(Enqueue(frame.id));
  while (!waiting_.empty() && graph_.region.frames.size() < kMaxFreeFrames + kMaxFixedFrames)
    MAPP_RETURN_IF_ERROR(ReadNext());
  if (graph_.region.frames.empty()) return graph_;
  MAPP_RETURN_IF_ERROR(FixGauge());
  LinkNeighborsInNumber();
  LinkCovisible();
  LinkMatches();
  MAPP_RETURN_IF_ERROR(RememberSnapshot());
  return std::move(graph_);
}

}  // namespace

StatusOr<LoopGraph> LoadLoopGraph(const CallContext& context, MapReader& reader, const Loop& loop) {
  return GraphLoader(context, reader, loop).Load();
}

double LinkError(const BundleProblem& problem, const BundleProblem::RelativePose& link) {
  const Pose3& T_world_from = problem.frames[static_cast<size_t>(link.from_idx)].T_world_camera;
  const Pose3& T_world_to = problem.frames[static_cast<size_t>(link.to_idx)].T_world_camera;
  const Pose3 difference = link.T_from_to.Inverse() * (T_world_from.Inverse() * T_world_to);
  const double error_m = difference.translation().norm() / link.sigma_m;
  const double error_rad = LogSo3(difference.rotation()).norm() / link.sigma_rad;
  return std::sqrt((error_m * error_m + error_rad * error_rad) / 6);
}

}  // namespace mapp
