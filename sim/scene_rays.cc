#include "sim/scene_rays.h"

#include "mapp/base/check.h"
#include "sim/embree_scene.h"

#include <algorithm>
#include <cmath>
#include <embree3/rtcore.h>
#include <limits>
#include <utility>

namespace mapp::sim {
namespace {

/// Of a point to a rectangle: outside its sides the distance to the nearest point of its border.
double DistanceToQuad(const Quad& quad, const Eigen::Vector3d& p_world) {
  const Eigen::Vector3d from_corner = p_world - quad.corner_world;
  const double u = std::clamp(from_corner.dot(quad.edge_u_world) / quad.edge_u_world.squaredNorm(), 0.0, 1.0);
  const double v = std::clamp(from_corner.dot(quad.edge_v_world) / quad.edge_v_world.squaredNorm(), 0.0, 1.0);
  return (from_corner - u * quad.edge_u_world - v * quad.edge_v_world).norm();
}

struct NearestSearch {
  const Scene* scene = nullptr;
  Eigen::Vector3d p_world;
  double distance_m = std::numeric_limits<double>::infinity();
};

/// Called by Embree for each rectangle whose box the search radius reaches.
bool VisitQuad(RTCPointQueryFunctionArguments* arguments) {
  auto& search = *static_cast<NearestSearch*>(arguments->userPtr);
  const double distance_m = DistanceToQuad(search.scene->quads[arguments->primID], search.p_world);
  if (distance_m >= search.distance_m) return false;
  search.distance_m = distance_m;
  // Embree counts in float: the radius stays a little larger, or a rectangle nearly as near could be left out.
  constexpr double kRelativeSlack = 1e-5;
  constexpr double kSlack_m = 1e-4;
  arguments->query->radius = static_cast<float>(distance_m * (1 + kRelativeSlack) + kSlack_m);
  return true;
}

}  // namespace

SceneRays::SceneRays(std::shared_ptr<const Scene> scene)
    : scene_(std::move(scene)), embree_([&] {
        MAPP_CHECK(scene_ != nullptr);
        return std::make_unique<const EmbreeScene>(scene_->quads, 0, EmbreeScene::Lifetime::kLong);
      }()) {}

SceneRays::~SceneRays() = default;

bool SceneRays::Occluded(const Eigen::Vector3d& p_from_world, const Eigen::Vector3d& p_to_world,
                         double margin_m) const {
  const Eigen::Vector3d to = p_to_world - p_from_world;
  const double distance_m = to.norm();
  if (distance_m <= margin_m) return false;
  const Eigen::Vector3f direction = (to / distance_m).cast<float>();
  const Eigen::Vector3f origin = p_from_world.cast<float>();
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.filter = EmbreeScene::RejectBacks;
  RTCRay ray{};
  ray.org_x = origin.x();
  ray.org_y = origin.y();
  ray.org_z = origin.z();
  ray.dir_x = direction.x();
  ray.dir_y = direction.y();
  ray.dir_z = direction.z();
  ray.tfar = static_cast<float>(distance_m - margin_m);
  ray.mask = ~0U;
  rtcOccluded1(embree_->handle(), &context, &ray);
  return ray.tfar < 0;  // -infinity is Embree's sign of a hit
}

std::vector<uint8_t> SceneRays::Occluded(const Eigen::Vector3d& p_from_world,
                                         std::span<const Eigen::Vector3d> p_to_world, double margin_m) const {
  std::vector<uint8_t> occluded;
  occluded.reserve(p_to_world.size());
  for (const Eigen::Vector3d& p_world : p_to_world) occluded.push_back(Occluded(p_from_world, p_world, margin_m));
  return occluded;
}

double SceneRays::DistanceToSurface(const Eigen::Vector3d& p_world) const {
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  const Eigen::Vector3f p = p_world.cast<float>();
  RTCPointQuery query{p.x(), p.y(), p.z(), 0, std::numeric_limits<float>::infinity()};
  NearestSearch search{scene_.get(), p_world};
  rtcPointQuery(embree_->handle(), &query, &context, VisitQuad, &search);
  return search.distance_m;
}

std::vector<double> SceneRays::DistanceToSurface(std::span<const Eigen::Vector3d> p_world) const {
  std::vector<double> distances_m;
  distances_m.reserve(p_world.size());
  for (const Eigen::Vector3d& p : p_world) distances_m.push_back(DistanceToSurface(p));
  return distances_m;
}

}  // namespace mapp::sim
