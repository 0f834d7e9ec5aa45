#pragma once

#include "mapp/geometry/pose3.h"

namespace mapp {

/// A box that may be turned any way in the frame that its holder names (world or map). Its own frame stands at its
/// centre.
struct OrientedBox {
  Pose3 T_frame_box;
  Eigen::Vector3d size_m = Eigen::Vector3d::Zero();

  /// Whether the point is inside the box made larger by `margin_m` on every side.
  bool Contains(const Eigen::Vector3d& p_frame, double margin_m = 0) const;
  /// Around the box made larger likewise, along the frame's axes.
  Aabb BoundingBox(double margin_m = 0) const;
  double Volume() const { return size_m.prod(); }
};

/// A box that lies along the axes of frame `b`, told in frame `a`.
OrientedBox BoxIn(const Pose3& T_a_b, const Aabb& box_b);

/// Volume that both have in common over the volume that either has, in [0, 1]; 0 for boxes without volume. By 16^3
/// regular samples of the smaller box: off by up to 0.03 for boxes turned against each other.
double IntersectionOverUnion(const OrientedBox& a, const OrientedBox& b);

}  // namespace mapp
