#include "sim/ray_caster.h"

#include <algorithm>
#include <embree3/rtcore.h>
#include <limits>

namespace mapp::sim {
namespace {

constexpr uint32_t kSceneId = 0;
constexpr uint32_t kMovingId = 1;
constexpr size_t kPacket = 8;

/// What Embree hands through to the filter.
struct FilterContext {
  RTCIntersectContext embree;  ///< must come first
  const std::vector<std::vector<int32_t>>* view_of_quad;
};

/// Rays meet only what the camera may see: backs have no view.
void RejectWithoutView(const RTCFilterFunctionNArguments* arguments) {
  const auto& view_of_quad = *reinterpret_cast<const FilterContext*>(arguments->context)->view_of_quad;
  const unsigned int n = arguments->N;
  for (unsigned int i = 0; i < n; ++i) {
    if (arguments->valid[i] == 0) continue;
    const uint32_t geometry = RTCHitN_geomID(arguments->hit, n, i);
    if (view_of_quad[geometry][RTCHitN_primID(arguments->hit, n, i)] == kNoView) arguments->valid[i] = 0;
  }
}

}  // namespace

RayCaster::RayCaster(const EmbreeScene& scene, std::span<const Quad> quads, std::span<const Quad> moving_quads,
                     const Eigen::AlignedBox2f& ray_bounds, const Pose3& T_world_camera)
    : scene_(scene),
      view_of_quad_(2),
      R_world_camera_(T_world_camera.RotationMatrix().cast<float>()),
      p_world_(T_world_camera.translation().cast<float>()) {
  const ViewFinder finder(ray_bounds, T_world_camera);
  AddViews(quads, finder, view_of_quad_[kSceneId]);
  AddViews(moving_quads, finder, view_of_quad_[kMovingId]);
  if (!moving_quads.empty()) {
    moving_scene_ = std::make_unique<const EmbreeScene>(moving_quads, kMovingId, EmbreeScene::Lifetime::kOneFrame);
  }
}

void RayCaster::AddViews(std::span<const Quad> quads, const ViewFinder& finder, std::vector<int32_t>& view_of_quad) {
  view_of_quad.assign(quads.size(), kNoView);
  for (size_t i = 0; i < quads.size(); ++i) {
    if (auto view = finder.Find(quads[i])) {
      view_of_quad[i] = static_cast<int32_t>(views_.size());
      views_.push_back(*view);
    }
  }
}

void RayCaster::Cast(std::span<const Eigen::Vector2f> rays, std::span<int32_t> view_indices) const {
  for (size_t begin = 0; begin < rays.size(); begin += kPacket) {
    const size_t count = std::min(kPacket, rays.size() - begin);
    Cast8(rays.subspan(begin, count), view_indices.subspan(begin, count));
  }
}

void RayCaster::Cast8(std::span<const Eigen::Vector2f> rays, std::span<int32_t> view_indices) const {
  FilterContext context;
  rtcInitIntersectContext(&context.embree);
  context.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  context.embree.filter = RejectWithoutView;
  context.view_of_quad = &view_of_quad_;
  RTCRayHit8 packet;
  alignas(32) int valid[kPacket];
  for (size_t i = 0; i < kPacket; ++i) {
    const size_t lane = std::min(i, rays.size() - 1);
    valid[i] = i < rays.size() ? -1 : 0;
    // The direction's length along the optical axis is 1, so Embree's distances are depths.
    const Eigen::Vector3f direction = R_world_camera_ * rays[lane].homogeneous();
    packet.ray.org_x[i] = p_world_.x();
    packet.ray.org_y[i] = p_world_.y();
    packet.ray.org_z[i] = p_world_.z();
    packet.ray.dir_x[i] = direction.x();
    packet.ray.dir_y[i] = direction.y();
    packet.ray.dir_z[i] = direction.z();
    packet.ray.tnear[i] = static_cast<float>(kNearest_m);
    packet.ray.tfar[i] = std::numeric_limits<float>::infinity();
    packet.ray.time[i] = 0;
    packet.ray.mask[i] = ~0U;
    packet.ray.flags[i] = 0;
    packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid, scene_.handle(), &context.embree, &packet);
  if (moving_scene_ != nullptr) rtcIntersect8(valid, moving_scene_->handle(), &context.embree, &packet);
  for (size_t i = 0; i < rays.size(); ++i) {
    const uint32_t geometry = packet.hit.geomID[i];
    view_indices[i] = geometry == RTC_INVALID_GEOMETRY_ID ? kNoView : view_of_quad_[geometry][packet.hit.primID[i]];
  }
}

}  // namespace mapp::sim
