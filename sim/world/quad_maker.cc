#include "sim/world/quad_maker.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace mapp::sim {
namespace {

/// A window of `share` of a picture's edge (more than 1 repeats it) at a chance place, mirrored by chance.
std::pair<float, float> ChanceWindow(double share, Rng& rng) {
  const double start = share < 1 ? rng.Uniform(0, 1 - share) : rng.Uniform();
  auto from = static_cast<float>(start);
  auto to = static_cast<float>(start + share);
  if (rng.Uniform() < 0.5) std::swap(from, to);
  return {from, to};
}

}  // namespace

Rect UprightRect(const Eigen::Vector3d& left, const Eigen::Vector3d& right, double height_m) {
  return {left + Eigen::Vector3d(0, 0, height_m), right - left, {0, 0, -height_m}};
}

Rect FloorRect(const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  return {{min.x(), max.y(), min.z()}, {max.x() - min.x(), 0, 0}, {0, min.y() - max.y(), 0}};
}

Rect CeilingRect(const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  return {min, {max.x() - min.x(), 0, 0}, {0, max.y() - min.y(), 0}};
}

const Picture& QuadMaker::AnyOf(Material material) {
  const std::vector<Picture>& pictures = materials_.Of(material);
  return pictures[rng_.Below(pictures.size())];
}

void QuadMaker::Hang(const Rect& rect, const Picture& picture) {
  Quad quad;
  quad.corner_world = rect.corner;
  quad.edge_u_world = rect.edge_u;
  quad.edge_v_world = rect.edge_v;
  quad.texture = picture.texture;
  quads_.push_back(std::move(quad));
}

void QuadMaker::Cover(const Rect& rect, Material material) {
  const Picture& picture = AnyOf(material);
  Hang(rect, picture);
  const auto [u0, u1] = ChanceWindow(rect.edge_u.norm() / picture.width_m, rng_);
  const auto [v0, v1] = ChanceWindow(rect.edge_v.norm() / picture.height_m, rng_);
  quads_.back().window = {u0, v0, u1, v1};
}

void QuadMaker::Panels(const Rect& rect, Material material, double panel_m) {
  const auto columns = std::max(static_cast<int>(std::lround(rect.edge_u.norm() / panel_m)), 1);
  const auto rows = std::max(static_cast<int>(std::lround(rect.edge_v.norm() / panel_m)), 1);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      Cover({rect.corner + rect.edge_u * column / columns + rect.edge_v * row / rows, rect.edge_u / columns,
             rect.edge_v / rows},
            material);
    }
  }
}

void QuadMaker::Facade(const Rect& rect, Material material) {
  const Picture& first = materials_.Of(material).front();
  const auto columns = std::max(static_cast<int>(std::lround(rect.edge_u.norm() / first.width_m)), 1);
  const auto rows = std::max(static_cast<int>(std::lround(rect.edge_v.norm() / first.height_m)), 1);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      Hang({rect.corner + rect.edge_u * column / columns + rect.edge_v * row / rows, rect.edge_u / columns,
            rect.edge_v / rows},
           material);
    }
  }
}

void QuadMaker::Box(const Eigen::Vector3d& center, const Eigen::Vector3d& size_m, double yaw, const BoxLook& look) {
  const Eigen::Matrix3d R = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d half_m = 0.5 * size_m;
  const auto rect = [&](const Rect& of_box) {
    return Rect{center + R * of_box.corner, R * of_box.edge_u, R * of_box.edge_v};
  };
  const std::array<Eigen::Vector3d, 5> foot = {
      Eigen::Vector3d{-half_m.x(), -half_m.y(), -half_m.z()}, Eigen::Vector3d{half_m.x(), -half_m.y(), -half_m.z()},
      Eigen::Vector3d{half_m.x(), half_m.y(), -half_m.z()}, Eigen::Vector3d{-half_m.x(), half_m.y(), -half_m.z()},
      Eigen::Vector3d{-half_m.x(), -half_m.y(), -half_m.z()}};
  for (size_t i = 0; i + 1 < foot.size(); ++i) {
    const Rect side = rect(UprightRect(foot[i], foot[i + 1], size_m.z()));
    if (look.whole_pictures) {
      Hang(side, look.sides);
    } else {
      Cover(side, look.sides);
    }
  }
  Cover(rect(FloorRect({-half_m.x(), -half_m.y(), half_m.z()}, half_m)), look.top);
  if (look.with_bottom) Cover(rect(CeilingRect(-half_m, half_m)), look.sides);
}

void AppendTransformed(std::span<const Quad> quads_from, const Pose3& T_to_from, std::vector<Quad>& quads_to) {
  const Eigen::Matrix3d R_to_from = T_to_from.RotationMatrix();
  for (const Quad& quad_from : quads_from) {
    Quad& quad_to = quads_to.emplace_back(quad_from);
    quad_to.corner_world = T_to_from * quad_from.corner_world;
    quad_to.edge_u_world = R_to_from * quad_from.edge_u_world;
    quad_to.edge_v_world = R_to_from * quad_from.edge_v_world;
  }
}

Pose3 UprightPose(const Eigen::Vector3d& origin, double yaw) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())), origin};
}

}  // namespace mapp::sim
