#pragma once

#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <vector>

namespace mapp {

/// Direction against gravity, unit, in the frame of the poses: the one that the cameras' x axes are most nearly
/// perpendicular to, since people and vehicles hold cameras level; where the cameras have not turned, the one nearest
/// to their -y axes. Unit -y without cameras.
Eigen::Vector3d EstimateUp(const std::vector<Pose3>& T_map_cameras);

/// Orthographic projection along "down" into an image.
class TopView {
 public:
  /// Pixels of the image that the view may fill.
  struct Viewport {
    int left_px = 0;
    int top_px = 0;
    int width_px = 1;
    int height_px = 1;

    bool Contains(const Eigen::Vector2d& pixel) const {
      return pixel.x() >= left_px && pixel.x() < left_px + width_px && pixel.y() >= top_px &&
             pixel.y() < top_px + height_px;
    }
  };

  /// Fits all `T_map_cameras`, and `points_map` but for the outermost percent on each side, into the viewport, the
  /// smallest rectangle around them upright and its longer side along the viewport's.
  TopView(const std::vector<Pose3>& T_map_cameras, const std::vector<Eigen::Vector3d>& points_map,
          const Viewport& viewport);

  /// Looking the same way, with all of `always_map` and most of `mostly_map`, as above, fitted into the viewport.
  TopView FittedTo(const std::vector<Eigen::Vector3d>& always_map, const std::vector<Eigen::Vector3d>& mostly_map,
                   const Viewport& viewport) const;

  Eigen::Vector2d ToPixel(const Eigen::Vector3d& p_map) const;
  /// Metres along "up" from the map's origin.
  double Height(const Eigen::Vector3d& p_map) const { return up_.dot(p_map); }
  double pixels_per_m() const { return pixels_per_m_; }

 private:
  void Fit(const std::vector<Eigen::Vector3d>& always_map, const std::vector<Eigen::Vector3d>& mostly_map,
           const Viewport& viewport);

  Eigen::Vector3d up_;
  Eigen::Vector3d right_;  ///< of the image, in the map
  Eigen::Vector3d down_;
  Eigen::Vector2d center_m_ = Eigen::Vector2d::Zero();  ///< along right_, down_
  Eigen::Vector2d center_px_;
  double pixels_per_m_ = 1;
};

}  // namespace mapp
