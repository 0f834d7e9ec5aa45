#include "mapp/view/overlap.h"

#include <algorithm>

namespace mapp {
namespace {

/// Counts by the answer at hand.
struct Counter {
  const OverlapQuestion& question;
  std::span<const Eigen::Vector3d> own_points;

  OverlapCount operator()(const SampleStates& states) const {
    return CountBySamples(DrawSamples(question), states.redundant, own_points);
  }

  OverlapCount operator()(const OccupancyGrid& grid) const {
    OverlapCount count;
    for (const Eigen::Vector3d& p_camera : own_points) {
      const std::optional<Eigen::Vector3d> location = grid.Locate(question.camera, p_camera);
      count.redundant.push_back(location && grid.AnyWithin(*location, kOccupancyTolerance));
    }
    if (own_points.empty()) return count;
    const auto num_redundant = std::count(count.redundant.begin(), count.redundant.end(), true);
    count.overlap = static_cast<double>(num_redundant) / static_cast<double>(own_points.size());
    return count;
  }
};

}  // namespace

DepthSketch MakeQuerySketch(SamplerKind sampler, const Camera& camera, std::span<const Eigen::Vector3d> own_points) {
  switch (sampler) {
    case SamplerKind::kUniform:
      return {};
    case SamplerKind::kDepthSketch:
      return MakeDepthSketch(camera, own_points, {.near_share = 0.1, .far_share = 0.9});
    case SamplerKind::kOccupancy:
      return MakeDepthSketch(camera, own_points, {.near_share = 0, .far_share = 1});
  }
  return {};
}

SampleSet DrawSamples(const OverlapQuestion& question) {
  switch (question.sampler) {
    case SamplerKind::kUniform:
      return SampleUniform(question.camera.FieldOfView(), question.cone_range_m, question.num_samples);
    case SamplerKind::kDepthSketch:
      return SampleDepthSketch(question.camera, question.sketch, question.num_samples);
    case SamplerKind::kOccupancy:
      break;
  }
  return {};
}

OverlapCount CountOverlap(const OverlapQuestion& question, const OverlapAnswer& answer,
                          std::span<const Eigen::Vector3d> own_points) {
  return std::visit(Counter{question, own_points}, answer);
}

}  // namespace mapp
