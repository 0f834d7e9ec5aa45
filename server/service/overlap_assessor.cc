#include "server/service/overlap_assessor.h"

#include "mapp/view/sampler.h"
#include "server/service/view_search.h"

#include <utility>

namespace mapp {
namespace {

SampleSet MakeSamples(const MapView& view, const ViewQuery& query, int num_samples) {
  if (query.sampler == SamplerKind::kUniform) {
    return SampleUniform(view.camera.FieldOfView(), view.range_m, num_samples);
  }
  return SampleDepthSketch(view.camera, query.sketch, num_samples);
}

/// Holds every point that a search around a sample can reach.
Aabb SearchBox(const Pose3& T_map_camera, const SampleSet& samples) {
  Aabb box;
  for (const Eigen::Vector3f& p_camera : samples.p_camera) {
    const float radius_m =
        samples.kind == SamplerKind::kUniform ? samples.radius : BoundingRadius(p_camera, samples.radius);
    const Eigen::Vector3d p_map = T_map_camera * p_camera.cast<double>();
    box.extend(p_map - Eigen::Vector3d::Constant(radius_m));
    box.extend(p_map + Eigen::Vector3d::Constant(radius_m));
  }
  return box;
}

}  // namespace

StatusOr<std::vector<bool>> AssessSamples(TileCache& tiles, const MapView& view, const ViewQuery& query,
                                          int num_samples) {
  const SampleSet samples = MakeSamples(view, query, num_samples);
  MAPP_ASSIGN_OR_RETURN(auto tiles_in_reach, tiles.TilesInBox(view.map, SearchBox(view.T_map_camera, samples)));
  ViewSearch search(view.Cone(), std::move(tiles_in_reach));
  return samples.kind == SamplerKind::kUniform ? search.AnyWithin(samples.p_camera, samples.radius)
                                               : search.AnyWithinScaled(samples.p_camera, samples.radius);
}

}  // namespace mapp
