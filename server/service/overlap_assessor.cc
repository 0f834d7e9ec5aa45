#include "server/service/overlap_assessor.h"

#include "server/service/view_search.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace mapp {
namespace {

constexpr double kColumnWidth = 0.04;  // on the plane z = 1; see docs/decisions/0006-occupancy.md

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

StatusOr<SampleStates> AssessSamples(TileCache& tiles, const MapView& view, const SampleSet& samples) {
  MAPP_ASSIGN_OR_RETURN(auto tiles_in_reach, tiles.TilesInBox(view.map, SearchBox(view.T_map_camera, samples)));
  ViewSearch search(view.Cone(), std::move(tiles_in_reach));
  return SampleStates{samples.kind == SamplerKind::kUniform ? search.AnyWithin(samples.p_camera, samples.radius)
                                                            : search.AnyWithinScaled(samples.p_camera, samples.radius)};
}

/// Holds every bin, in scaled coordinates. Empty when there are none.
Eigen::AlignedBox3f BoundsOf(const OccupancyGrid& grid, const Camera& camera) {
  Eigen::AlignedBox3f box;
  const auto extend = [&](int column, int row, const OccupancyGrid::DepthRange& depths) {
    const Eigen::Vector2d pixel(static_cast<double>(column) * camera.width_px / grid.columns() - 0.5,
                                static_cast<double>(row) * camera.height_px / grid.rows() - 0.5);
    const Eigen::Vector3d ray = camera.Unproject(pixel);
    box.extend(ScaledCoordinates((grid.NearEnd(depths.first) * ray).cast<float>()));
    box.extend(ScaledCoordinates((grid.NearEnd(depths.first + depths.count) * ray).cast<float>()));
  };
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const OccupancyGrid::DepthRange depths = grid.DepthsOf(column, row);
      if (depths.count == 0) continue;
      extend(column, row, depths);
      extend(column + 1, row, depths);
      extend(column, row + 1, depths);
      extend(column + 1, row + 1, depths);
    }
  }
  return box;
}

/// The box around the frustum that a box in scaled coordinates is.
Aabb BoxInMap(const Pose3& T_map_camera, const Eigen::AlignedBox3f& scaled_box) {
  Aabb box;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3f scaled = scaled_box.corner(static_cast<Eigen::AlignedBox3f::CornerType>(corner));
    box.extend(T_map_camera * FromScaledCoordinates(scaled).cast<double>());
  }
  return box;
}

}  // namespace

OccupancyResolution ResolutionFor(const Camera& camera) {
  const double width = camera.width_px / camera.FocalLengths().x();
  const double columns_per_cell =
      std::clamp(width / kColumnWidth / DepthSketch::kColumns, 1.0, static_cast<double>(OccupancyResolution::kMax));
  return {.subdivision = static_cast<int>(std::lround(columns_per_cell)), .depth_steps = 2};
}

StatusOr<OccupancyGrid> AssessBins(TileCache& tiles, const MapView& view, const DepthSketch& sketch,
                                   OccupancyResolution resolution) {
  OccupancyGrid grid(sketch, resolution);
  const Eigen::AlignedBox3f bounds = BoundsOf(grid, view.camera);
  if (bounds.isEmpty()) return grid;
  MAPP_ASSIGN_OR_RETURN(auto tiles_in_reach, tiles.TilesInBox(view.map, BoxInMap(view.T_map_camera, bounds)));
  ViewSearch search(view.Cone(), std::move(tiles_in_reach));
  for (const Eigen::Vector3f& scaled : search.PointsSeenAlike(bounds)) {
    const Eigen::Vector3d p_camera = FromScaledCoordinates(scaled).cast<double>();
    const std::optional<Eigen::Vector3d> location = grid.Locate(view.camera, p_camera);
    if (!location) continue;
    const Eigen::Vector3i bin = location->array().floor().cast<int>();
    grid.Occupy(bin.x(), bin.y(), bin.z());
  }
  return grid;
}

StatusOr<OverlapAnswer> AssessView(TileCache& tiles, const MapView& view, const ViewQuery& query, int num_samples) {
  if (query.sampler == SamplerKind::kOccupancy) {
    MAPP_ASSIGN_OR_RETURN(OccupancyGrid grid, AssessBins(tiles, view, query.sketch, ResolutionFor(view.camera)));
    return OverlapAnswer(std::move(grid));
  }
  const OverlapQuestion question{view.camera, view.range_m, query.sampler, query.sketch, num_samples};
  MAPP_ASSIGN_OR_RETURN(SampleStates states, AssessSamples(tiles, view, DrawSamples(question)));
  return OverlapAnswer(std::move(states));
}

}  // namespace mapp
