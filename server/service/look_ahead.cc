#include "server/service/look_ahead.h"

#include "storage/map_store.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>
#include <unordered_set>

namespace mapp {
namespace {

/// Between the poses looked from: a view changes little over less.
constexpr double kViewStepM = 2.0;
/// A session came by here when one of its frames was taken no farther away ...
constexpr double kPassingM = 4.0;
/// ... looking and going like this one, to within 60 degrees.
constexpr double kMinCosAlike = 0.5;
/// More ways than these are crowds on the same one.
constexpr size_t kMaxWays = 4;
/// Frames farther apart are no way: the device did not map in between, or the box ends there.
constexpr double kMaxWayGapM = 6.0;

using FramesInOrder = std::vector<const FrameRecord*>;

const Eigen::Vector3d& WhereTaken(const FrameRecord& frame) { return frame.T_frame_camera.translation(); }

Eigen::Vector3d AxisAt(const Pose3& T_map_camera) { return T_map_camera.rotation() * Eigen::Vector3d::UnitZ(); }

bool PointAlike(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.dot(b) >= kMinCosAlike * a.norm() * b.norm();
}

struct Passage {
  double distance_m = 0;
  const FramesInOrder* frames = nullptr;
  size_t idx = 0;  ///< of the frame nearest to the device
};

std::optional<Passage> FindPassage(const FramesInOrder& frames, const Pose3& T_map_camera,
                                   const Eigen::Vector3d& motion_map) {
  std::optional<Passage> nearest;
  // The last frame leads nowhere.
  for (size_t i = 0; i + 1 < frames.size(); ++i) {
    const double distance_m = (WhereTaken(*frames[i]) - T_map_camera.translation()).norm();
    if (distance_m > kPassingM || (nearest && distance_m >= nearest->distance_m)) continue;
    if (!PointAlike(AxisAt(frames[i]->T_frame_camera), AxisAt(T_map_camera))) continue;
    const Eigen::Vector3d onward = WhereTaken(*frames[i + 1]) - WhereTaken(*frames[i]);
    if (!motion_map.isZero() && !PointAlike(onward, motion_map)) continue;
    nearest = Passage{distance_m, &frames, i};
  }
  return nearest;
}

void AppendWay(const Passage& passage, double distance_m, std::vector<WayPose>& way) {
  const FramesInOrder& frames = *passage.frames;
  double way_m = 0, last_m = 0;
  for (size_t i = passage.idx + 1; i < frames.size(); ++i) {
    const double step_m = (WhereTaken(*frames[i]) - WhereTaken(*frames[i - 1])).norm();
    way_m += step_m;
    if (step_m > kMaxWayGapM || way_m > distance_m) return;
    const bool looks_elsewhere =
        way.empty() || !PointAlike(AxisAt(frames[i]->T_frame_camera), AxisAt(way.back().T_map_camera));
    if (way_m - last_m < kViewStepM && !looks_elsewhere) continue;
    way.push_back({frames[i]->T_frame_camera, way_m});
    last_m = way_m;
  }
}

}  // namespace

std::vector<WayPose> StraightAhead(const Pose3& T_map_camera, const Eigen::Vector3d& motion_map, double distance_m) {
  std::vector<WayPose> way;
  if (motion_map.isZero()) return way;
  const Eigen::Vector3d direction_map = motion_map.normalized();
  for (double way_m = kViewStepM; way_m <= distance_m; way_m += kViewStepM) {
    way.push_back({Pose3(T_map_camera.rotation(), T_map_camera.translation() + way_m * direction_map), way_m});
  }
  return way;
}

std::vector<WayPose> EarlierWays(std::span<const FrameRecord> frames, const Pose3& T_map_camera,
                                 const Eigen::Vector3d& motion_map, double distance_m) {
  std::map<SessionId, FramesInOrder> by_session;
  for (const FrameRecord& frame : frames) by_session[frame.session].push_back(&frame);
  std::vector<Passage> passages;
  for (auto& [session, of_session] : by_session) {
    std::ranges::sort(of_session, {}, [](const FrameRecord* frame) { return frame->number; });
    if (const auto passage = FindPassage(of_session, T_map_camera, motion_map)) passages.push_back(*passage);
  }
  std::ranges::stable_sort(passages, {}, &Passage::distance_m);
  if (passages.size() > kMaxWays) passages.resize(kMaxWays);
  std::vector<WayPose> ways;
  for (const Passage& passage : passages) {
    std::vector<WayPose> way;
    AppendWay(passage, distance_m, way);
    std::ranges::copy(way, std::back_inserter(ways));
  }
  return ways;
}

StatusOr<std::vector<WayPose>> PredictWay(MapReader& reader, const MapView& view, const Eigen::Vector3d& motion_map,
                                          double distance_m, bool earlier_ways) {
  std::vector<WayPose> way = StraightAhead(view.T_map_camera, motion_map, distance_m);
  if (earlier_ways) {
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(std::max(distance_m, kPassingM));
    const Eigen::Vector3d& center = view.T_map_camera.translation();
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames,
                          reader.FramesInBox(view.map, Aabb(center - reach, center + reach)));
    std::ranges::copy(EarlierWays(frames, view.T_map_camera, motion_map, distance_m), std::back_inserter(way));
  }
  std::ranges::stable_sort(way, {}, &WayPose::way_m);
  return way;
}

std::vector<TileKey> TilesAhead(std::span<const WayPose> way, const ViewCone& cone, const TileGrid& grid) {
  std::vector<TileKey> keys;
  std::unordered_set<TileKey> seen;
  for (const WayPose& pose : way) {
    const ViewCone there{pose.T_map_camera, cone.range_m, cone.field_of_view};
    for (const TileKey& key : TilesInView(there, grid)) {
      if (seen.insert(key).second) keys.push_back(key);
    }
  }
  return keys;
}

}  // namespace mapp
