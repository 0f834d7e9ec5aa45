#include "eval/harness/visible_changes.h"

#include "mapp/geometry/oriented_box.h"
#include "sim/features/feature_camera.h"

#include <algorithm>
#include <optional>

namespace mapp {
namespace {

/// So many features of a thing, over the poses looked at, make it seen.
constexpr size_t kMinFeatures = 50;
constexpr size_t kPoseStep = 5;
/// Beyond RGB-D's range, with the thing's own size.
constexpr double kMaxDistance_m = 12;

/// Looks out of visits at things as they stood at other times.
class Looker {
 public:
  static StatusOr<Looker> Create(const std::shared_ptr<const sim::FeatureWorld>& world,
                                 std::span<const sim::Visit> visits) {
    Looker looker(visits);
    for (const sim::Visit& visit : visits) {
      MAPP_ASSIGN_OR_RETURN(auto camera, sim::FeatureCamera::Create(world, visit.rig, {}, /*seed=*/1));
      looker.cameras_.push_back(std::move(camera));
    }
    return looker;
  }

  /// Whether one of the visits that ended before (began after) `stamp_ns` would have seen enough of the thing, had the
  /// world been as at `scene_ns`.
  bool IsSeen(uint32_t object_id, const Pose3& T_world_object, int64_t scene_ns, int64_t stamp_ns, bool after) const {
    for (size_t i = 0; i < visits_.size(); ++i) {
      const bool is_after = visits_[i].poses.front().stamp_ns > stamp_ns;
      if (is_after == after && CountIn(i, object_id, T_world_object, scene_ns)) return true;
    }
    return false;
  }

 private:
  explicit Looker(std::span<const sim::Visit> visits) : visits_(visits) {}

  bool CountIn(size_t visit, uint32_t object_id, const Pose3& T_world_object, int64_t scene_ns) const {
    size_t count = 0;
    for (size_t i = 0; i < visits_[visit].poses.size() && count < kMinFeatures; i += kPoseStep) {
      const Pose3& T_world_camera = visits_[visit].poses[i].T_world_camera;
      const Eigen::Vector3d p_camera = T_world_camera.Inverse() * T_world_object.translation();
      if (p_camera.norm() > kMaxDistance_m || p_camera.z() < 0) continue;
      count += static_cast<size_t>(
          std::ranges::count_if(cameras_[visit]->Observe(T_world_camera, scene_ns),
                                [&](const auto& seen) { return seen.object_id == object_id && seen.depth_m > 0; }));
    }
    return count >= kMinFeatures;
  }

  std::span<const sim::Visit> visits_;
  std::vector<std::unique_ptr<sim::FeatureCamera>> cameras_;
};

/// Boxes that have so much in common are of one place (ChangeMatching).
constexpr double kSamePlaceIou = 0.2;

/// Whether something else stands where the object stood or stands.
bool IsTaken(const sim::World& world, uint32_t object_id, const Pose3& T_world_object, int64_t scene_ns) {
  const auto object = std::ranges::find(world.objects, object_id, &sim::WorldObject::id);
  const OrientedBox place{T_world_object, object->size_m};
  return std::ranges::any_of(world.objects, [&](const sim::WorldObject& other) {
    if (other.id == object_id) return false;
    const std::optional<Pose3>& T_world_other = other.At(scene_ns);
    return T_world_other && IntersectionOverUnion(place, {*T_world_other, other.size_m}) >= kSamePlaceIou;
  });
}

/// Whether the change leaves a place empty, or fills an empty one, between the visits around it: the shape of a place
/// says nothing of one like thing that was put in place of another.
bool ChangesAPlace(const sim::World& world, const sim::WorldChange& change, std::span<const sim::Visit> visits) {
  int64_t before_ns = change.stamp_ns - 1, after_ns = change.stamp_ns;
  for (const sim::Visit& visit : visits) {
    const int64_t begun_ns = visit.poses.front().stamp_ns;
    if (begun_ns < change.stamp_ns) before_ns = visit.poses.back().stamp_ns;
    if (begun_ns < change.stamp_ns) continue;
    after_ns = begun_ns;
    break;
  }
  const bool leaves =
      change.T_world_object_before && !IsTaken(world, change.object_id, *change.T_world_object_before, after_ns);
  const bool fills =
      change.T_world_object_after && !IsTaken(world, change.object_id, *change.T_world_object_after, before_ns);
  return leaves || fills;
}

}  // namespace

StatusOr<SortedChanges> SortChanges(const std::shared_ptr<const sim::FeatureWorld>& world,
                                    std::span<const sim::Visit> visits) {
  MAPP_ASSIGN_OR_RETURN(const Looker looker, Looker::Create(world, visits));
  SortedChanges sorted;
  for (const sim::WorldChange& change : sim::ChangesOf(world->world())) {
    const auto is_seen = [&](const std::optional<Pose3>& T_world_object, int64_t scene_ns) {
      if (!T_world_object) return true;
      for (const bool after : {false, true}) {
        if (!looker.IsSeen(change.object_id, *T_world_object, scene_ns, change.stamp_ns, after)) return false;
      }
      return true;
    };
    const bool is_visible = ChangesAPlace(world->world(), change, visits) &&
                            is_seen(change.T_world_object_before, change.stamp_ns - 1) &&
                            is_seen(change.T_world_object_after, change.stamp_ns);
    (is_visible ? sorted.visible : sorted.others).push_back(change);
  }
  return sorted;
}

}  // namespace mapp
