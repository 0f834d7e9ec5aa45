#include "server/service/optimizer_region.h"

#include "server/service/frame_view.h"
#include "server/service/odometry_links.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <set>
#include <unordered_set>

namespace mapp {
namespace {

/// Around the session's camera centres, where covisible frames are looked for besides the points' known observers.
constexpr double kSearchMarginM = 2.0;
/// A frame with fewer shared points is not held well by them: it is carried, not adjusted.
constexpr int kMinPointsPerFrame = 30;
/// Depth cameras are better than the usual weight of their depths says, which alignment keeps for what distant sessions
/// disagree in: by this much, where one map is adjusted to all its depths.
constexpr double kRgbdDepthTrust = 3;
/// A frame that sees fewer of the free points adds nothing as border.
constexpr int kMinBorderPoints = 5;

class RegionLoader {
 public:
  RegionLoader(const CallContext& context, MapReader& reader, const OptimizerOptions& options)
      : context_(context), reader_(reader), options_(options) {}

  StatusOr<OptimizerRegion> Load(std::span<const FrameRecord> session_frames);

 private:
  struct Member {
    FrameRecord record;
    std::vector<Observation> observations;
  };
  using FrameScores = std::vector<std::pair<int, FrameId>>;

  /// Reads a frame of the map with its observations, once. Null for a frame that is not in the map.
  StatusOr<const Member*> Read(FrameId frame);
  Status AddFree(FrameId frame);
  Aabb BoxAroundFree() const;
  /// Frames other than the free ones that may see the free points, with the number that they do see, most first.
  StatusOr<FrameScores> SharingFrames();
  Status ChooseCovisible();
  Status ChooseBorder();
  Status ReadPoints();
  void SplitWeakFrames();
  std::map<MapPointId, int> CountObservers() const;
  void BuildFrames(OptimizerRegion& region);
  void BuildPoints(OptimizerRegion& region);
  Status BuildObservations(OptimizerRegion& region);
  Status BuildFrameObservations(const Member& member, int frame_idx, OptimizerRegion& region);
  void BuildCarried(OptimizerRegion& region) const;
  Status LinkByOdometry(OptimizerRegion& region);
  Status FixGauge(OptimizerRegion& region);
  void RememberSnapshot(OptimizerRegion& region) const;

  const CallContext& context_;
  MapReader& reader_;
  const OptimizerOptions& options_;
  std::map<FrameId, Member> members_;  ///< every frame read so far
  std::set<FrameId> free_;
  std::set<FrameId> weak_;  ///< of the session or covisible, but carried
  std::set<FrameId> border_;
  std::map<MapPointId, PointRecord> points_;  ///< live, seen by free frames
  std::map<MapPointId, int> point_indices_;
  std::map<FrameId, int> frame_indices_;
  OdometryLinks odometry_;
};

StatusOr<const RegionLoader::Member*> RegionLoader::Read(FrameId frame) {
  auto known = members_.find(frame);
  if (known == members_.end()) {
    MAPP_RETURN_IF_ERROR(context_.Check());
    Member member;
    MAPP_ASSIGN_OR_RETURN(member.record, reader_.GetFrame(frame));
    if (member.record.in_map) {
      MAPP_ASSIGN_OR_RETURN(member.observations, reader_.GetObservations(frame));
    }
    known = members_.emplace(frame, std::move(member)).first;
  }
  return known->second.record.in_map ? &known->second : nullptr;
}

Status RegionLoader::AddFree(FrameId frame) {
  MAPP_ASSIGN_OR_RETURN(const Member* const member, Read(frame));
  if (member != nullptr) free_.insert(frame);
  return absl::OkStatus();
}

/// Reads the live points of the free frames that are not read yet.
Status RegionLoader::ReadPoints() {
  std::set<MapPointId> missing;
  for (const FrameId frame : free_) {
    for (const Observation& observation : members_.at(frame).observations) {
      if (!points_.contains(observation.point)) missing.insert(observation.point);
    }
  }
  const std::vector<MapPointId> ids(missing.begin(), missing.end());
  MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, reader_.FindPoints(ids));
  for (PointRecord& point : points) {
    const MapPointId id = point.id;
    if (point.in_map) points_.emplace(id, std::move(point));
  }
  return absl::OkStatus();
}

Aabb RegionLoader::BoxAroundFree() const {
  Aabb box;
  for (const FrameId frame : free_) box.extend(members_.at(frame).record.T_frame_camera.translation());
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(kSearchMarginM);
  return Aabb(box.min() - margin, box.max() + margin);
}

StatusOr<RegionLoader::FrameScores> RegionLoader::SharingFrames() {
  std::set<FrameId> candidates;
  for (const auto& [id, point] : points_) candidates.insert(point.observers.begin(), point.observers.end());
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> near,
                        reader_.FramesInBox(members_.at(*free_.begin()).record.map, BoxAroundFree()));
  for (const FrameRecord& frame : near) candidates.insert(frame.id);

  FrameScores scores;
  for (const FrameId candidate : candidates) {
    if (free_.contains(candidate)) continue;
    MAPP_ASSIGN_OR_RETURN(const Member* const member, Read(candidate));
    if (member == nullptr) continue;
    const auto num_shared = std::count_if(member->observations.begin(), member->observations.end(),
                                          [this](const Observation& o) { return points_.contains(o.point); });
    scores.emplace_back(static_cast<int>(num_shared), candidate);
  }
  std::sort(scores.begin(), scores.end(),
            [](const auto& a, const auto& b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
  return scores;
}

Status RegionLoader::ChooseCovisible() {
  MAPP_ASSIGN_OR_RETURN(const FrameScores scores, SharingFrames());
  for (const auto& [num_shared, frame] : scores) {
    if (num_shared < options_.min_shared_points || static_cast<int>(free_.size()) >= options_.max_free_frames) break;
    MAPP_RETURN_IF_ERROR(AddFree(frame));
  }
  return absl::OkStatus();
}

Status RegionLoader::ChooseBorder() {
  MAPP_ASSIGN_OR_RETURN(const FrameScores scores, SharingFrames());
  for (const auto& [num_shared, frame] : scores) {
    if (num_shared < kMinBorderPoints || static_cast<int>(border_.size()) >= options_.max_free_frames) break;
    border_.insert(frame);
  }
  return absl::OkStatus();
}

std::map<MapPointId, int> RegionLoader::CountObservers() const {
  std::map<MapPointId, int> counts;
  for (const std::set<FrameId>* frames : {&free_, &border_}) {
    for (const FrameId frame : *frames) {
      for (const Observation& observation : members_.at(frame).observations) {
        if (points_.contains(observation.point)) ++counts[observation.point];
      }
    }
  }
  return counts;
}

void RegionLoader::SplitWeakFrames() {
  const std::map<MapPointId, int> counts = CountObservers();
  for (const FrameId frame : free_) {
    const std::vector<Observation>& observations = members_.at(frame).observations;
    const auto num_shared = std::count_if(observations.begin(), observations.end(), [&counts](const Observation& o) {
      const auto count = counts.find(o.point);
      return count != counts.end() && count->second >= 2;
    });
    if (num_shared < kMinPointsPerFrame) weak_.insert(frame);
  }
  for (const FrameId frame : weak_) free_.erase(frame);
}

void RegionLoader::BuildFrames(OptimizerRegion& region) {
  for (const std::set<FrameId>* frames : {&free_, &border_}) {
    for (const FrameId frame : *frames) {
      frame_indices_.emplace(frame, static_cast<int>(region.frames.size()));
      const FrameRecord& record = members_.at(frame).record;
      region.frames.push_back(record);
      region.problem.frames.push_back(
          {.camera = {}, .T_world_camera = record.T_frame_camera, .fixed = frames == &border_});
    }
  }
}

void RegionLoader::BuildPoints(OptimizerRegion& region) {
  for (const auto& [point, num_observers] : CountObservers()) {
    if (num_observers < 2) continue;
    point_indices_.emplace(point, static_cast<int>(region.points.size()));
    region.points.push_back(points_.at(point));
    region.problem.points.push_back({.p_world = points_.at(point).position});
  }
}

Status RegionLoader::BuildFrameObservations(const Member& member, int frame_idx, OptimizerRegion& region) {
  MAPP_RETURN_IF_ERROR(context_.Check());
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader_, member.record.id));
  BundleProblem::Frame& frame = region.problem.frames[frame_idx];
  frame.camera = view.pinhole;
  frame.bf_px_m = DepthWeightBf(view.camera) * (view.camera.stereo_baseline_m > 0 ? 1 : kRgbdDepthTrust);
  odometry_.Add(frame_idx, view);
  for (const Observation& observation : member.observations) {
    const auto point_idx = point_indices_.find(observation.point);
    if (point_idx == point_indices_.end()) continue;
    region.observations.push_back(observation);
    region.problem.observations.push_back(
        {.frame_idx = frame_idx,
         .point_idx = point_idx->second,
         .pixel = view.undistorted_px[observation.feature_idx],
         .sigma_px = OctaveScale(view.keyframe.features[observation.feature_idx].keypoint.octave),
         .depth_m = observation.depth_m});
  }
  return absl::OkStatus();
}

Status RegionLoader::BuildObservations(OptimizerRegion& region) {
  for (const auto& [frame, frame_idx] : frame_indices_) {
    MAPP_RETURN_IF_ERROR(BuildFrameObservations(members_.at(frame), frame_idx, region));
  }
  return absl::OkStatus();
}

void RegionLoader::BuildCarried(OptimizerRegion& region) const {
  for (const FrameId frame : weak_) {
    const FrameRecord& record = members_.at(frame).record;
    region.carried_frames.push_back({.record = record, .reference_idx = region.ReferenceOf(record)});
  }
  std::set<MapPointId> carried;
  for (const std::set<FrameId>* frames : {&free_, &weak_}) {
    for (const FrameId frame : *frames) {
      for (const Observation& observation : members_.at(frame).observations) {
        const auto point = points_.find(observation.point);
        if (point == points_.end() || point_indices_.contains(observation.point)) continue;
        if (carried.insert(observation.point).second) {
          region.carried_points.push_back({.record = point->second, .frame = frame});
        }
      }
    }
  }
}

Status RegionLoader::LinkByOdometry(OptimizerRegion& region) {
  MAPP_ASSIGN_OR_RETURN(region.problem.relative_poses, odometry_.Build(reader_));
  std::erase_if(region.problem.relative_poses, [&region](const BundleProblem::RelativePose& link) {
    return region.problem.frames[link.from_idx].fixed && region.problem.frames[link.to_idx].fixed;
  });
  return absl::OkStatus();
}

/// The frame that defined the map's frame stays where it is; a region that neither holds it nor has a border keeps its
/// earliest frame.
Status RegionLoader::FixGauge(OptimizerRegion& region) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader_.GetMap(region.frames.front().map));
  bool has_fixed = false;
  for (size_t i = 0; i < region.frames.size(); ++i) {
    const FrameRecord& frame = region.frames[i];
    if (frame.number == 0 && map.founder == frame.session) region.problem.frames[i].fixed = true;
    has_fixed |= region.problem.frames[i].fixed;
  }
  if (has_fixed) return absl::OkStatus();
  const auto earliest = std::min_element(region.frames.begin(), region.frames.end(),
                                         [](const FrameRecord& a, const FrameRecord& b) { return a.id < b.id; });
  region.problem.frames[earliest - region.frames.begin()].fixed = true;
  return absl::OkStatus();
}

void RegionLoader::RememberSnapshot(OptimizerRegion& region) const {
  region.box_map = BoxAroundFree();
  for (const auto& [frame, member] : members_) {
    if (member.record.in_map) region.known_frames.insert(frame);
  }
  for (const auto& [point, record] : points_) region.known_points.insert(point);
}

StatusOr<OptimizerRegion> RegionLoader::Load(std::span<const FrameRecord> session_frames) {
  for (const FrameRecord& frame : session_frames) MAPP_RETURN_IF_ERROR(AddFree(frame.id));
  if (free_.empty()) return OptimizerRegion();
  MAPP_RETURN_IF_ERROR(ReadPoints());
  MAPP_RETURN_IF_ERROR(ChooseCovisible());
  MAPP_RETURN_IF_ERROR(ReadPoints());
  MAPP_RETURN_IF_ERROR(ChooseBorder());
  SplitWeakFrames();
  OptimizerRegion region;
  if (free_.empty()) return region;
  BuildFrames(region);
  BuildPoints(region);
  MAPP_RETURN_IF_ERROR(BuildObservations(region));
  BuildCarried(region);
  MAPP_RETURN_IF_ERROR(FixGauge(region));
  MAPP_RETURN_IF_ERROR(LinkByOdometry(region));
  RememberSnapshot(region);
  return region;
}

}  // namespace

int OptimizerRegion::num_free_frames() const {
  return static_cast<int>(std::count_if(problem.frames.begin(), problem.frames.end(),
                                        [](const BundleProblem::Frame& frame) { return !frame.fixed; }));
}

StatusOr<OptimizerRegion> LoadOptimizerRegion(const CallContext& context, MapReader& reader,
                                              std::span<const FrameRecord> session_frames,
                                              const OptimizerOptions& options) {
  return RegionLoader(context, reader, options).Load(session_frames);
}

int OptimizerRegion::ReferenceOf(const FrameRecord& frame) const {
  int best_idx = 0;
  auto best_rank = std::make_pair(true, std::numeric_limits<double>::infinity());
  for (int i = 0; i < static_cast<int>(frames.size()); ++i) {
    if (problem.frames[i].fixed) continue;
    const bool is_other_session = frames[i].session != frame.session;
    const double gap = is_other_session ? Distance(frames[i].T_frame_camera, frame.T_frame_camera)
                                        : std::abs(static_cast<double>(frames[i].number) - frame.number);
    const auto rank = std::make_pair(is_other_session, gap);
    if (rank < best_rank) {
      best_rank = rank;
      best_idx = i;
    }
  }
  return best_idx;
}

double ReprojectionRmse(const BundleProblem& problem) {
  double sum = 0;
  for (const BundleProblem::Observation& observation : problem.observations) {
    const BundleProblem::Frame& frame = problem.frames[observation.frame_idx];
    const Eigen::Vector3d p_camera = frame.T_world_camera.Inverse() * problem.points[observation.point_idx].p_world;
    double error_px = kTruncationPx;
    if (p_camera.z() > 0) {
      error_px = std::min(error_px, (frame.camera.Project(p_camera) - observation.pixel).norm() / observation.sigma_px);
    }
    sum += error_px * error_px;
  }
  const size_t count = problem.observations.size();
  return count == 0 ? 0 : std::sqrt(sum / static_cast<double>(count));
}

}  // namespace mapp
