#include "server/service/view_search.h"

#include "mapp/view/sampler.h"
#include "server/service/scaled_grid.h"

#include <cmath>
#include <utility>

namespace mapp {
namespace {

const float kCosLikeView = static_cast<float>(std::cos(kLikeViewAngle));

/// Tests points in the camera's frame against a box in scaled coordinates, without a division or a logarithm.
class FrustumTest {
 public:
  explicit FrustumTest(const Eigen::AlignedBox3f& scaled_box)
      : low_(scaled_box.min()),
        high_(scaled_box.max()),
        nearest_(std::exp(2 * low_.z())),
        farthest_(std::exp(2 * high_.z())) {}

  bool Contains(const Eigen::Vector3f& p_camera) const {
    const float z = p_camera.z();
    return z >= nearest_ && z <= farthest_ && p_camera.x() >= low_.x() * z && p_camera.x() <= high_.x() * z &&
           p_camera.y() >= low_.y() * z && p_camera.y() <= high_.y() * z;
  }

 private:
  Eigen::Vector3f low_;
  Eigen::Vector3f high_;
  float nearest_;
  float farthest_;
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

bool ViewSearch::HasNeighborObserver(size_t tile, const LoadedPoint& point) {
  for (uint32_t i = 0; i < point.num_observers; ++i) {
    if (IsNeighborFrame(tile, point.observer_frames[i])) return true;
  }
  return false;
}

bool ViewSearch::IsSeenAlike(size_t tile, const LoadedPoint& point) {
  const Eigen::Vector3f ray = point.p_map - center_;
  const float least_dot = kCosLikeView * ray.norm();
  for (uint32_t i = 0; i < point.num_observers; ++i) {
    if (point.observer_directions[i].dot(ray) >= least_dot && IsNeighborFrame(tile, point.observer_frames[i])) {
      return true;
    }
  }
  return false;
}

std::vector<bool> ViewSearch::AnyWithin(std::span<const Eigen::Vector3f> p_camera, float radius_m) {
  std::vector<bool> found;
  found.reserve(p_camera.size());
  for (const Eigen::Vector3f& p : p_camera) {
    const Eigen::Vector3f p_map = R_map_camera_ * p + center_;
    bool any = false;
    for (size_t t = 0; t < tiles_.size() && !any; ++t) {
      any = tiles_[t]->AnyWithin(p_map, radius_m,
                                 [&](const LoadedPoint& point) { return HasNeighborObserver(t, point); });
    }
    found.push_back(any);
  }
  return found;
}

std::vector<Eigen::Vector3f> ViewSearch::PointsSeenAlike(const Eigen::AlignedBox3f& scaled_box) {
  const FrustumTest frustum(scaled_box);
  const Eigen::Matrix3f R_camera_map = R_map_camera_.transpose();
  std::vector<Eigen::Vector3f> scaled;
  for (size_t t = 0; t < tiles_.size(); ++t) {
    tiles_[t]->ForEachPosition([&](const Eigen::Vector3f& p_map, const LoadedPoint& point) {
      const Eigen::Vector3f p_camera = R_camera_map * (p_map - center_);
      if (frustum.Contains(p_camera) && IsSeenAlike(t, point)) scaled.push_back(ScaledCoordinates(p_camera));
    });
  }
  return scaled;
}

std::vector<bool> ViewSearch::AnyWithinScaled(std::span<const Eigen::Vector3f> p_camera, float radius) {
  std::vector<Eigen::Vector3f> asked;
  asked.reserve(p_camera.size());
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : p_camera) {
    asked.push_back(ScaledCoordinates(p));
    box.extend(asked.back());
  }
  if (asked.empty()) return {};
  const Eigen::Vector3f margin = Eigen::Vector3f::Constant(radius);
  const ScaledGrid grid(PointsSeenAlike({box.min() - margin, box.max() + margin}), radius);
  std::vector<bool> found;
  found.reserve(asked.size());
  for (const Eigen::Vector3f& scaled : asked) found.push_back(grid.AnyWithin(scaled));
  return found;
}

}  // namespace mapp
