#include "mapp/base/rng.h"
#include "sim/world/draft.h"
#include "sim/world/world.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

using Places = std::vector<Eigen::Vector3d>;

/// Whether a place lies within reach of any of `near`; all do when there are none.
bool IsWithinReach(const Eigen::Vector3d& p_world, const Places& near, double reach_m) {
  return near.empty() || std::any_of(near.begin(), near.end(),
                                     [&](const Eigen::Vector3d& place) { return (place - p_world).norm() <= reach_m; });
}

constexpr int64_t kHour_ns = 3'600'000'000'000;

/// The times between visits, in order; the hour after them if there is no time between.
std::vector<std::pair<int64_t, int64_t>> GapsBetween(std::vector<std::pair<int64_t, int64_t>> visits_ns,
                                                     int num_stable_visits) {
  std::ranges::sort(visits_ns);
  // Up to the last of the stable ones there is no gap.
  for (int i = 0; i + 1 < num_stable_visits; ++i)
    visits_ns[static_cast<size_t>(i)].second = visits_ns[static_cast<size_t>(i) + 1].first;
  std::vector<std::pair<int64_t, int64_t>> gaps;
  int64_t end_ns = visits_ns.empty() ? 0 : visits_ns.front().second;
  for (const auto& [from_ns, to_ns] : visits_ns) {
    if (from_ns > end_ns) gaps.emplace_back(end_ns, from_ns);
    end_ns = std::max(end_ns, to_ns);
  }
  if (gaps.empty()) gaps.emplace_back(end_ns, end_ns + kHour_ns);
  return gaps;
}

/// `count` times, evenly over the gaps put end to end, each inside a gap.
std::vector<int64_t> TimesInGaps(const std::vector<std::pair<int64_t, int64_t>>& gaps, int count) {
  double total_ns = 0;
  for (const auto& [from_ns, to_ns] : gaps) total_ns += static_cast<double>(to_ns - from_ns);
  std::vector<int64_t> times_ns;
  for (int i = 0; i < count; ++i) {
    double left_ns = total_ns * (i + 0.5) / count;
    for (const auto& [from_ns, to_ns] : gaps) {
      const auto length_ns = static_cast<double>(to_ns - from_ns);
      if (left_ns < length_ns || &to_ns == &gaps.back().second) {
        times_ns.push_back(std::min<int64_t>(from_ns + std::llround(left_ns), to_ns - 1));
        break;
      }
      left_ns -= length_ns;
    }
  }
  return times_ns;
}

template <typename T>
T TakeAny(std::vector<T>& items, Rng& rng) {
  std::swap(items[rng.Below(items.size())], items.back());
  T item = std::move(items.back());
  items.pop_back();
  return item;
}

/// Deals out changes, one to an object, in the order of time.
class ChangeMaker {
 public:
  ChangeMaker(const WorldOptions& options, const std::vector<Spot>& free_spots, Rng& rng, World& world)
      : rng_(rng), world_(world) {
    const auto may_change = [&](const Eigen::Vector3d& p_world) {
      return IsWithinReach(p_world, options.change_near_world, options.change_reach_m);
    };
    std::ranges::copy_if(free_spots, std::back_inserter(free_spots_),
                         [&](const Spot& spot) { return may_change(spot.ground_world); });
    for (size_t i = 0; i < world.objects.size(); ++i) {
      if (may_change(world.objects[i].placements.front().T_world_object->translation())) unchanged_.push_back(i);
    }
  }
  size_t num_changeable() const { return unchanged_.size(); }

  /// `kind` gives way to kVanished where no spot is free.
  void Make(ChangeKind kind, int64_t stamp_ns) {
    const size_t pattern = unchanged_[rng_.Below(unchanged_.size())];
    const std::optional<Pose3> T_world_object =
        kind == ChangeKind::kVanished ? std::nullopt : TakeSpot(world_.objects[pattern].size_m);
    if (kind == ChangeKind::kAppeared && T_world_object) {
      WorldObject object = world_.objects[pattern];  // another one of that model
      object.id = static_cast<uint32_t>(world_.objects.size() + 1);
      for (Quad& quad : object.quads_object) quad.object_id = object.id;
      object.placements = {{.T_world_object = std::nullopt}, {stamp_ns, T_world_object}};
      world_.objects.push_back(std::move(object));
      return;
    }
    std::erase(unchanged_, pattern);
    WorldObject& object = world_.objects[pattern];
    const Pose3 T_world_before = *object.placements.front().T_world_object;
    object.placements.push_back({stamp_ns, T_world_object});
    free_spots_.push_back(SpotOf(object, T_world_before));
  }

 private:
  static Spot SpotOf(const WorldObject& object, const Pose3& T_world_object) {
    const Eigen::Vector3d x_world = T_world_object.rotation() * Eigen::Vector3d::UnitX();
    return {T_world_object.translation() - Eigen::Vector3d(0, 0, 0.5 * object.size_m.z()),
            std::atan2(x_world.y(), x_world.x()), object.size_m};
  }

  /// Any free spot that a thing of this size fits in; nullopt if there is none.
  std::optional<Pose3> TakeSpot(const Eigen::Vector3d& size_m) {
    std::vector<size_t> fitting;
    for (size_t i = 0; i < free_spots_.size(); ++i) {
      if (((free_spots_[i].size_m - size_m).array() >= -1e-9).all()) fitting.push_back(i);
    }
    if (fitting.empty()) return std::nullopt;
    const size_t spot_idx = fitting[rng_.Below(fitting.size())];
    const Spot spot = free_spots_[spot_idx];
    free_spots_.erase(free_spots_.begin() + static_cast<std::ptrdiff_t>(spot_idx));
    return UprightPose(spot.ground_world + Eigen::Vector3d(0, 0, 0.5 * size_m.z()), spot.yaw);
  }

  std::vector<Spot> free_spots_;
  std::vector<size_t> unchanged_;  ///< indices of objects that stand there from the beginning on
  Rng& rng_;
  World& world_;
};

}  // namespace

Status AddChanges(const WorldOptions& options, const std::vector<Spot>& free_spots, World& world) {
  if (options.num_changes == 0) return absl::OkStatus();
  Rng rng(SeedOf(options.seed, 2));
  ChangeMaker maker(options, free_spots, rng, world);
  const size_t num_objects = maker.num_changeable();
  if (static_cast<size_t>(options.num_changes) > num_objects) {
    return absl::InvalidArgumentError(fmt::format("num_changes: {}, but the {} has {} things that can change",
                                                  options.num_changes, world.setting, num_objects));
  }
  const std::vector<ChangeKind> all = {ChangeKind::kAppeared, ChangeKind::kVanished, ChangeKind::kMoved};
  // Kinds in blocks of three in a chance order, so that few changes are of all kinds too.
  std::vector<ChangeKind> kinds;
  for (const int64_t stamp_ns :
       TimesInGaps(GapsBetween(options.visits_ns, options.num_stable_visits), options.num_changes)) {
    if (kinds.empty()) kinds = options.change_kinds.empty() ? all : options.change_kinds;
    maker.Make(TakeAny(kinds, rng), stamp_ns);
  }
  return absl::OkStatus();
}

std::vector<WorldChange> ChangesOf(const World& world) {
  std::vector<WorldChange> changes;
  for (const WorldObject& object : world.objects) {
    for (size_t i = 1; i < object.placements.size(); ++i) {
      const std::optional<Pose3>& before = object.placements[i - 1].T_world_object;
      const std::optional<Pose3>& after = object.placements[i].T_world_object;
      if (!before && !after) continue;
      const ChangeKind kind = !before ? ChangeKind::kAppeared : !after ? ChangeKind::kVanished : ChangeKind::kMoved;
      changes.push_back({object.placements[i].from_ns, object.id, kind, before, after});
    }
  }
  std::ranges::stable_sort(changes, {}, &WorldChange::stamp_ns);
  return changes;
}

}  // namespace mapp::sim
