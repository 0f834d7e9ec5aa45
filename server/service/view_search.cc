#include "server/service/view_search.h"

#include "mapp/view/sampler.h"

#include <cmath>
#include <limits>
#include <utility>

namespace mapp {
namespace {

const float kCosLikeView = static_cast<float>(std::cos(kLikeViewAngle));

/// Scaled coordinates of a point that does not count: within no radius of anything.
const Eigen::Vector3f kNowhere = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity());

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
  scaled_points_.resize(tiles_.size());
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
    const auto is_neighbor_point = [&](const LoadedPoint& point, size_t /*slot*/) {
      for (uint32_t i = 0; i < point.num_observers; ++i) {
        if (IsNeighborFrame(t, point.observer_frames[i])) return true;
      }
      return false;
    };
    if (tiles_[t]->AnyWithin(p_map, radius_m, is_neighbor_point)) return true;
  }
  return false;
}

Eigen::Vector3f ViewSearch::ScaledIfSeenAlike(size_t tile, const LoadedPoint& point) {
  const Eigen::Vector3f from_center = point.p_map - center_;
  const Eigen::Vector3f p_camera = R_map_camera_.transpose() * from_center;
  if (p_camera.z() <= 0) return kNowhere;
  const float least_dot = kCosLikeView * from_center.norm();
  for (uint32_t i = 0; i < point.num_observers; ++i) {
    if (point.observer_directions[i].dot(from_center) >= least_dot && IsNeighborFrame(tile, point.observer_frames[i])) {
      return ScaledCoordinates(p_camera);
    }
  }
  return kNowhere;
}

bool ViewSearch::AnyWithinScaled(const Eigen::Vector3f& p_camera, float radius) {
  const Eigen::Vector3f p_map = ToMap(p_camera);
  const float radius_m = BoundingRadius(p_camera, radius);
  const Eigen::Vector3f scaled = ScaledCoordinates(p_camera);
  const float squared_radius = radius * radius;
  for (size_t t = 0; t < tiles_.size(); ++t) {
    // Samples lie closely: each point is met by many, so it is judged once. A compact array also spares the cache.
    std::vector<ScaledPoint>& scaled_points = scaled_points_[t];
    if (scaled_points.empty()) scaled_points.resize(tiles_[t]->num_slots());
    const auto holds = [&](const LoadedPoint& point, size_t slot) {
      ScaledPoint& candidate = scaled_points[slot];
      if (!candidate.known) candidate = {ScaledIfSeenAlike(t, point), true};
      return (candidate.position - scaled).squaredNorm() <= squared_radius;
    };
    if (tiles_[t]->AnyWithin(p_map, radius_m, holds)) return true;
  }
  return false;
}

}  // namespace mapp
