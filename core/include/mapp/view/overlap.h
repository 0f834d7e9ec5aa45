#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/view/occupancy.h"
#include "mapp/view/sampler.h"

#include <Eigen/Core>

#include <span>
#include <variant>
#include <vector>

namespace mapp {

/// What both sides know of a query about a view, besides its pose (DESIGN 5).
struct OverlapQuestion {
  Camera camera;
  double cone_range_m = 0;  ///< h of the map
  SamplerKind sampler = SamplerKind::kDepthSketch;
  DepthSketch sketch;
  int num_samples = 0;  ///< K
};

/// The samplers' answer: one entry per sample, in the order in which both sides derive them.
struct SampleStates {
  std::vector<bool> redundant;
};
/// What the server answers: occupied bins to kOccupancy, else states.
using OverlapAnswer = std::variant<SampleStates, OccupancyGrid>;

/// What the query tells of the keyframe's own points. depth_sketch: the 10th and 90th percentile of their depth in each
/// cell. occupancy: the whole range, since a point without a bin could not be asked about. uniform: nothing.
DepthSketch MakeQuerySketch(SamplerKind sampler, const Camera& camera, std::span<const Eigen::Vector3d> own_points);

/// The samples of the question; none for kOccupancy.
SampleSet DrawSamples(const OverlapQuestion& question);

/// The device's count: which of its own points (camera frame, metres) the map already holds. Of states by the rules of
/// CountBySamples; of occupied bins where a bin within kOccupancyTolerance of the point is occupied.
OverlapCount CountOverlap(const OverlapQuestion& question, const OverlapAnswer& answer,
                          std::span<const Eigen::Vector3d> own_points);

/// Bins. The study that chose it and the resolution: docs/decisions/0006-occupancy.md.
inline constexpr double kOccupancyTolerance = 0.5;

}  // namespace mapp
