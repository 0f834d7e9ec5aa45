#pragma once

#include "eval/metrics/statistics.h"
#include "mapp/base/status.h"
#include "mapp/geometry/oriented_box.h"
#include "sim/world/world.h"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace mapp {

/// What became of one object.
struct TrueChange {
  sim::ChangeKind kind = sim::ChangeKind::kVanished;
  std::optional<OrientedBox> before;  ///< where it stood; absent when it appeared
  std::optional<OrientedBox> after;   ///< where it stands; absent when it vanished
  int64_t stamp_ns = 0;
};
/// With the boxes of the world's objects. NOT_FOUND: a change of an object that the world does not have.
StatusOr<std::vector<TrueChange>> TrueChangesOf(const sim::World& world, std::span<const sim::WorldChange> changes);

/// What a detector says: vanished has `before`, appeared `after`, moved at least one of them.
struct DetectedChange {
  sim::ChangeKind kind = sim::ChangeKind::kVanished;
  std::optional<OrientedBox> before;
  std::optional<OrientedBox> after;
  /// Between which times it happened, both included; absent: the detector does not tell.
  std::optional<std::pair<int64_t, int64_t>> window_ns;
};

struct ChangeMatching {
  double min_iou = 0.2;       ///< boxes are of one place when they have so much in common,
  double margin_m = 0.1;      ///< or when the detected one's centre is in the true one made larger by this
  int64_t time_slack_ns = 0;  ///< the true time may lie outside the detected window by this
};

/// Detections against changes of one kind.
struct ChangeCounts {
  size_t num_true = 0;      ///< changes of this kind
  size_t num_found = 0;     ///< of them, those that a right detection tells of
  size_t num_detected = 0;  ///< detections of this kind
  size_t num_right = 0;     ///< of them, those that are so
  std::optional<double> Precision() const;
  std::optional<double> Recall() const;
};

struct ChangeScore {
  ChangeCounts all;
  std::array<ChangeCounts, 3> by_kind;  ///< index: sim::ChangeKind
  std::vector<double> right_ious;       ///< of the right detections: IntersectionOverUnion with the true box
  // Why the other detections are wrong; together with all.num_right they are all.num_detected.
  size_t num_false = 0;       ///< nothing changed there
  size_t num_duplicate = 0;   ///< another detection told of it already
  size_t num_wrong_kind = 0;  ///< something changed there, but not so
  size_t num_wrong_time = 0;  ///< it changed there and so, but not then

  const ChangeCounts& Of(sim::ChangeKind kind) const { return by_kind[static_cast<size_t>(kind)]; }
};

/// Pairs detections with changes one to one, best overlap first. An object that moved has left one place and come to
/// another: it is found by a detection that it moved (naming at least one place rightly) or by one that something
/// vanished from the first or appeared at the second; these two are both right.
/// INVALID_ARGUMENT: a detection or change without the box that its kind needs.
StatusOr<ChangeScore> ScoreChanges(std::span<const TrueChange> changes, std::span<const DetectedChange> detections,
                                   const ChangeMatching& matching = {});

/// Points that were said to have changed against those that have: those inside one of the boxes, made larger by
/// `margin_m`. INVALID_ARGUMENT when the sizes differ.
StatusOr<BinaryScore> ScoreChangedPoints(std::span<const Eigen::Vector3d> p_world, const std::vector<bool>& detected,
                                         std::span<const OrientedBox> changed_boxes, double margin_m);

}  // namespace mapp
