#pragma once

#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"
#include "synthetic_views.h"

#include <functional>
#include <utility>

namespace mapp {

/// TestTile whose points can be judged from where they were seen: they are detected at 1.7 to 7 m.
inline Tile JudgedTile(Revision revision, int num_points = 900) {
  Tile tile = TestTile(revision, num_points);
  for (TilePoint& point : tile.points) point.reference_distance_m = 6;
  return tile;
}

/// What a camera at the session's origin measures along the rays to the tile's points under TestAlignment(): a surface
/// at the point itself, or, where `is_gone(p_camera)`, one at three times its depth.
inline Keyframe ViewOf(
    const Tile& tile, int64_t stamp_ns,
    const std::function<bool(const Eigen::Vector3d&)>& is_gone = [](const auto&) { return false; }) {
  const Camera camera = TestCamera();
  Keyframe view;
  view.stamp_ns = stamp_ns;
  uint64_t number = 0;
  for (const TilePoint& point : tile.points) {
    const Eigen::Vector3d p_camera = TestAlignment().Inverse() * point.p_map.cast<double>();
    const Eigen::Vector2d pixel = camera.Project(p_camera);
    KeyframeFeature feature;
    feature.keypoint.u_px = static_cast<float>(pixel.x());
    feature.keypoint.v_px = static_cast<float>(pixel.y());
    feature.point = PointReference{.id = ++number,
                                   .depth_m = static_cast<float>((is_gone(p_camera) ? 3 : 1) * p_camera.z()),
                                   .num_observations = 1};
    view.features.push_back(feature);
  }
  return view;
}

}  // namespace mapp
