#include "eval/metrics/change_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

namespace mapp {
namespace {

using sim::ChangeKind;

bool HasItsBoxes(ChangeKind kind, bool before, bool after, bool both_needed) {
  switch (kind) {
    case ChangeKind::kAppeared:
      return after;
    case ChangeKind::kVanished:
      return before;
    case ChangeKind::kMoved:
      return both_needed ? before && after : before || after;
  }
  return false;
}

/// Scores of detections against changes.
class Matcher {
 public:
  Matcher(std::span<const TrueChange> changes, std::span<const DetectedChange> detections,
          const ChangeMatching& matching)
      : changes_(changes),
        detections_(detections),
        matching_(matching),
        taken_(changes.size()),
        right_(detections.size()) {}

  ChangeScore Run() {
    ChangeScore score;
    Assign(score);
    for (size_t t = 0; t < changes_.size(); ++t) {
      for (ChangeCounts* counts : {&score.all, &score.by_kind[static_cast<size_t>(changes_[t].kind)]}) {
        ++counts->num_true;
        counts->num_found += taken_[t].before || taken_[t].after ? 1 : 0;
      }
    }
    for (size_t d = 0; d < detections_.size(); ++d) {
      for (ChangeCounts* counts : {&score.all, &score.by_kind[static_cast<size_t>(detections_[d].kind)]}) {
        ++counts->num_detected;
        counts->num_right += right_[d] ? 1 : 0;
      }
      if (!right_[d]) ++(score.*WhyWrong(d));
    }
    return score;
  }

 private:
  /// Which of a change's places are spoken for.
  struct Places {
    bool before = false;
    bool after = false;
  };

  /// How well the boxes agree: above 0 when they are of one place.
  double Agreement(const std::optional<OrientedBox>& detected, const std::optional<OrientedBox>& actual) const {
    if (!detected || !actual) return 0;
    const double iou = IntersectionOverUnion(*detected, *actual);
    if (iou >= matching_.min_iou) return iou;
    constexpr double kCenterOnly = 1e-6;  // comes after every agreement in volume
    return actual->Contains(detected->T_frame_box.translation(), matching_.margin_m) ? kCenterOnly + iou : 0;
  }

  /// Which places of the change the detection tells of, kinds considered.
  Places Told(const DetectedChange& detected, const TrueChange& change) const {
    if (detected.kind == ChangeKind::kMoved && change.kind != ChangeKind::kMoved) return {};
    return {detected.kind != ChangeKind::kAppeared && Agreement(detected.before, change.before) > 0,
            detected.kind != ChangeKind::kVanished && Agreement(detected.after, change.after) > 0};
  }

  bool IsInTime(const DetectedChange& detected, const TrueChange& change) const {
    return !detected.window_ns || (change.stamp_ns >= detected.window_ns->first - matching_.time_slack_ns &&
                                   change.stamp_ns <= detected.window_ns->second + matching_.time_slack_ns);
  }

  void Assign(ChangeScore& score) {
    std::vector<std::tuple<double, size_t, size_t>> candidates;  // -agreement, detection, change
    for (size_t d = 0; d < detections_.size(); ++d) {
      for (size_t t = 0; t < changes_.size(); ++t) {
        const Places told = Told(detections_[d], changes_[t]);
        if ((!told.before && !told.after) || !IsInTime(detections_[d], changes_[t])) continue;
        const double before = told.before ? Agreement(detections_[d].before, changes_[t].before) : 0;
        const double after = told.after ? Agreement(detections_[d].after, changes_[t].after) : 0;
        candidates.emplace_back(-std::max(before, after), d, t);
      }
    }
    std::ranges::sort(candidates);
    for (const auto& [negative_agreement, d, t] : candidates) {
      const Places told = Told(detections_[d], changes_[t]);
      if (right_[d] || (told.before && taken_[t].before) || (told.after && taken_[t].after)) continue;
      right_[d] = true;
      score.right_ious.push_back(-negative_agreement);
      // Who says that it moved has told of both places, even if one of them wrongly.
      const bool moved = detections_[d].kind == ChangeKind::kMoved;
      taken_[t].before = taken_[t].before || told.before || moved;
      taken_[t].after = taken_[t].after || told.after || moved;
    }
  }

  size_t ChangeScore::*WhyWrong(size_t d) const {
    const DetectedChange& detected = detections_[d];
    bool right_but_late = false;
    bool something = false;
    for (const TrueChange& change : changes_) {
      const Places told = Told(detected, change);
      if (told.before || told.after) {
        if (IsInTime(detected, change)) return &ChangeScore::num_duplicate;
        right_but_late = true;
      }
      for (const auto& said : {detected.before, detected.after}) {
        something = something || Agreement(said, change.before) > 0 || Agreement(said, change.after) > 0;
      }
    }
    if (right_but_late) return &ChangeScore::num_wrong_time;
    return something ? &ChangeScore::num_wrong_kind : &ChangeScore::num_false;
  }

  std::span<const TrueChange> changes_;
  std::span<const DetectedChange> detections_;
  const ChangeMatching& matching_;
  std::vector<Places> taken_;
  std::vector<bool> right_;
};

}  // namespace

StatusOr<std::vector<TrueChange>> TrueChangesOf(const sim::World& world, std::span<const sim::WorldChange> changes) {
  std::vector<TrueChange> true_changes;
  for (const sim::WorldChange& change : changes) {
    const auto object = std::ranges::find(world.objects, change.object_id, &sim::WorldObject::id);
    if (object == world.objects.end()) {
      return absl::NotFoundError(fmt::format("change: the world has no object {}", change.object_id));
    }
    TrueChange& added = true_changes.emplace_back();
    added.kind = change.kind;
    added.stamp_ns = change.stamp_ns;
    if (change.T_world_object_before) added.before = OrientedBox{*change.T_world_object_before, object->size_m};
    if (change.T_world_object_after) added.after = OrientedBox{*change.T_world_object_after, object->size_m};
  }
  return true_changes;
}

std::optional<double> ChangeCounts::Precision() const {
  return Ratio(static_cast<double>(num_right), static_cast<double>(num_detected));
}

std::optional<double> ChangeCounts::Recall() const {
  return Ratio(static_cast<double>(num_found), static_cast<double>(num_true));
}

StatusOr<ChangeScore> ScoreChanges(std::span<const TrueChange> changes, std::span<const DetectedChange> detections,
                                   const ChangeMatching& matching) {
  for (size_t t = 0; t < changes.size(); ++t) {
    if (!HasItsBoxes(changes[t].kind, changes[t].before.has_value(), changes[t].after.has_value(), true)) {
      return absl::InvalidArgumentError(fmt::format("change {}: lacks a box that its kind needs", t));
    }
  }
  for (size_t d = 0; d < detections.size(); ++d) {
    if (!HasItsBoxes(detections[d].kind, detections[d].before.has_value(), detections[d].after.has_value(), false)) {
      return absl::InvalidArgumentError(fmt::format("detection {}: lacks a box that its kind needs", d));
    }
  }
  return Matcher(changes, detections, matching).Run();
}

StatusOr<BinaryScore> ScoreChangedPoints(std::span<const Eigen::Vector3d> p_world, const std::vector<bool>& detected,
                                         std::span<const OrientedBox> changed_boxes, double margin_m) {
  if (detected.size() != p_world.size()) {
    return absl::InvalidArgumentError(
        fmt::format("detected: must have an entry for each of {} points, got {}", p_world.size(), detected.size()));
  }
  BinaryScore score;
  for (size_t i = 0; i < p_world.size(); ++i) {
    const bool changed =
        std::ranges::any_of(changed_boxes, [&](const OrientedBox& box) { return box.Contains(p_world[i], margin_m); });
    score.Add(detected[i], changed);
  }
  return score;
}

}  // namespace mapp
