#include "server/service/view_search.h"

#include "mapp/view/sampler.h"

#include <cmath>
#include <utility>

namespace mapp {
namespace {

const float kCosLikeView = static_cast<float>(std::cos(kLikeViewAngle));

/// The ball around one sample in scaled coordinates, tested without a logarithm where the lateral distance decides.
struct ScaledBall {
  Eigen::Vector3f center;  // scaled coordinates
  float squared_radius;

  bool Contains(const Eigen::Vector3f& p_camera) const {
    if (p_camera.z() <= 0) return false;
    const float inverse_z = 1 / p_camera.z();
    const float dx = p_camera.x() * inverse_z - center.x();
    const float dy = p_camera.y() * inverse_z - center.y();
    const float lateral = dx * dx + dy * dy;
    if (lateral > squared_radius) return false;
    const float dz = 0.5F * std::log(p_camera.z()) - center.z();
    return lateral + dz * dz <= squared_radius;
  }
};

}  // namespace

float BoundingRadius(const Eigen::Vector3f& p_camera, float radius) {
  // With s = z (X, Y, 1), a point at scaled offset (dx, dy, dz) lies at z e^(2 dz) (X + dx, Y + dy, 1), so that
  //   |p - s| <= z (|(X, Y, 1)| (e^(2 dz) - 1) + e^(2a) |(dx, dy)|),  e^(2 dz) - 1 <= (e^(2a) - 1) dz / a,
  // whose greatest value under dx^2 + dy^2 + dz^2 <= a^2 is (Cauchy-Schwarz):
  const float growth = std::exp(2 * radius);
  const float along = (growth - 1) * p_camera.norm();
  const float across = growth * radius * p_camera.z();
  return std::sqrt(along * along + across * across);
}

ViewSearch::ViewSearch(const ViewCone& cone, std::vector<std::shared_ptr<const LoadedTile>> tiles)
    : cone_(cone),
      R_map_camera_(cone.T_map_camera.RotationMatrix().cast<float>()),
      center_(cone.T_map_camera.translation().cast<float>()),
      tiles_(std::move(tiles)) {
  judgements_.reserve(tiles_.size());
  for (const auto& tile : tiles_) judgements_.emplace_back(tile->frames().size(), Judgement::kUnknown);
}

bool ViewSearch::IsNeighborFrame(size_t tile, uint32_t frame) {
  Judgement& judgement = judgements_[tile][frame];
  if (judgement == Judgement::kUnknown) {
    const TileFrame& candidate = tiles_[tile]->frames()[frame];
    const bool neighbor = IsNeighbor(cone_, candidate.T_map_camera, candidate.field_of_view);
    judgement = neighbor ? Judgement::kNeighbor : Judgement::kStranger;
  }
  return judgement == Judgement::kNeighbor;
}

bool ViewSearch::AnyWithin(const Eigen::Vector3f& p_camera, float radius_m) {
  const Eigen::Vector3f p_map = ToMap(p_camera);
  for (size_t t = 0; t < tiles_.size(); ++t) {
    const auto is_neighbor_point = [&](const LoadedPoint& point) {
      for (uint32_t i = 0; i < point.num_observers; ++i) {
        if (IsNeighborFrame(t, point.observer_frames[i])) return true;
      }
      return false;
    };
    if (tiles_[t]->AnyWithin(p_map, radius_m, is_neighbor_point)) return true;
  }
  return false;
}

bool ViewSearch::AnyWithinScaled(const Eigen::Vector3f& p_camera, float radius) {
  const Eigen::Vector3f p_map = ToMap(p_camera);
  const float radius_m = BoundingRadius(p_camera, radius);
  const ScaledBall ball{ScaledCoordinates(p_camera), radius * radius};
  for (size_t t = 0; t < tiles_.size(); ++t) {
    const auto holds = [&](const LoadedPoint& point) {
      const Eigen::Vector3f from_center = point.p_map - center_;
      if (!ball.Contains(R_map_camera_.transpose() * from_center)) return false;
      const float least_dot = kCosLikeView * from_center.norm();
      for (uint32_t i = 0; i < point.num_observers; ++i) {
        if (point.observer_directions[i].dot(from_center) >= least_dot &&
            IsNeighborFrame(t, point.observer_frames[i])) {
          return true;
        }
      }
      return false;
    };
    if (tiles_[t]->AnyWithin(p_map, radius_m, holds)) return true;
  }
  return false;
}

}  // namespace mapp
