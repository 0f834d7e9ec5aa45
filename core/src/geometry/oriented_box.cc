#include "mapp/geometry/oriented_box.h"

namespace mapp {

bool OrientedBox::Contains(const Eigen::Vector3d& p_frame, double margin_m) const {
  const Eigen::Vector3d p_box = T_frame_box.Inverse() * p_frame;
  return (p_box.cwiseAbs().array() <= size_m.array() / 2 + margin_m).all();
}

Aabb OrientedBox::BoundingBox(double margin_m) const {
  const Eigen::Vector3d half_m = size_m / 2 + Eigen::Vector3d::Constant(margin_m);
  const Eigen::Vector3d reach_m = T_frame_box.RotationMatrix().cwiseAbs() * half_m;
  return {T_frame_box.translation() - reach_m, T_frame_box.translation() + reach_m};
}

OrientedBox BoxIn(const Pose3& T_a_b, const Aabb& box_b) {
  return {T_a_b * Pose3(Eigen::Quaterniond::Identity(), box_b.center()), box_b.sizes()};
}

double IntersectionOverUnion(const OrientedBox& a, const OrientedBox& b) {
  const OrientedBox& smaller = a.Volume() <= b.Volume() ? a : b;
  const OrientedBox& larger = a.Volume() <= b.Volume() ? b : a;
  if (!(smaller.Volume() > 0)) return 0;
  constexpr int kSteps = 16;
  const Pose3 T_larger_smaller = larger.T_frame_box.Inverse() * smaller.T_frame_box;
  const OrientedBox at_origin{Pose3(), larger.size_m};
  int num_common = 0;
  for (int x = 0; x < kSteps; ++x) {
    for (int y = 0; y < kSteps; ++y) {
      for (int z = 0; z < kSteps; ++z) {
        const Eigen::Vector3d share = (Eigen::Vector3d(x, y, z).array() + 0.5) / kSteps - 0.5;
        num_common += at_origin.Contains(T_larger_smaller * share.cwiseProduct(smaller.size_m)) ? 1 : 0;
      }
    }
  }
  const double common = smaller.Volume() * num_common / (kSteps * kSteps * kSteps);
  return common / (a.Volume() + b.Volume() - common);
}

}  // namespace mapp
