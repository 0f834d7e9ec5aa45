#include "sim/features/feature_world.h"

#include "mapp/base/check.h"
#include "sim/bake_lights.h"
#include "sim/features/hash.h"
#include "sim/features/outlines.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

namespace mapp::sim {
namespace {

/// Pictures whose texels are this much longer than wide count as square.
constexpr double kAspectStep = 1.1;
/// Tells people's surfaces from those of objects.
constexpr uint64_t kPasserTag = 0x9a55e5ULL;

/// The same surface, described from its opposite corner.
Quad HalfTurned(Quad quad) {
  quad.corner_world += quad.edge_u_world + quad.edge_v_world;
  quad.edge_u_world = -quad.edge_u_world;
  quad.edge_v_world = -quad.edge_v_world;
  std::swap(quad.window.u0, quad.window.u1);
  std::swap(quad.window.v0, quad.window.v1);
  std::reverse(quad.light.factors.begin(), quad.light.factors.end());
  return quad;
}

/// Adds what follows from the surfaces.
void Complete(FeatureScene& scene) {
  scene.num_outline_corners = FindOutlines(scene.surfaces);
  for (const FeatureSurface& surface : scene.surfaces) scene.bounds.emplace_back(surface);
}

}  // namespace

double FeatureSurface::Light(const Eigen::Vector2d& fraction) const {
  if (light.factors.empty()) return 1;
  const double x = fraction.x() * (light.columns - 1);
  const double y = fraction.y() * (light.rows - 1);
  const int x0 = std::clamp(static_cast<int>(x), 0, light.columns - 1);
  const int y0 = std::clamp(static_cast<int>(y), 0, light.rows - 1);
  const int x1 = std::min(x0 + 1, light.columns - 1);
  const int y1 = std::min(y0 + 1, light.rows - 1);
  const auto at = [&](int column, int row) {
    return static_cast<double>(light.factors[static_cast<size_t>(row * light.columns + column)]);
  };
  const double top = at(x0, y0) + (x - x0) * (at(x1, y0) - at(x0, y0));
  const double bottom = at(x0, y1) + (x - x0) * (at(x1, y1) - at(x0, y1));
  return top + (y - y0) * (bottom - top);
}

SurfaceBounds::SurfaceBounds(const FeatureSurface& surface)
    : center_world((surface.corner_world + (surface.edge_u_world + surface.edge_v_world) / 2).cast<float>()),
      radius_m(static_cast<float>((surface.edge_u_world + surface.edge_v_world).norm() / 2)),
      normal_world(surface.normal_world.cast<float>()),
      plane_offset_m(static_cast<float>(surface.normal_world.dot(surface.corner_world))),
      shorter_edge_m(static_cast<float>(std::min(surface.length_u_m, surface.length_v_m))),
      has_outline(std::ranges::any_of(surface.outline, [](const OutlineCorner& corner) { return corner.id != 0; })) {}

FeatureWorld::FeatureWorld(std::shared_ptr<const World> world) : world_(std::move(world)) {
  MAPP_CHECK(world_ != nullptr);
  for (const WorldChange& change : ChangesOf(*world_)) change_stamps_ns_.push_back(change.stamp_ns);
}

std::shared_ptr<const TextureCorners> FeatureWorld::PictureOf(const Quad& quad, double log_aspect) const {
  const bool flip_u = quad.window.u1 < quad.window.u0;
  const double step = std::log(kAspectStep);
  const int aspect = static_cast<int>(std::lround(log_aspect / step));
  MutexLock lock(mutex_);
  std::shared_ptr<const TextureCorners>& picture = pictures_[PictureKey(quad.texture.get(), flip_u, aspect)];
  if (picture == nullptr) {
    picture = std::make_shared<const TextureCorners>(TexturePicture{quad.texture, flip_u, aspect * step});
  }
  return picture;
}

FeatureSurface FeatureWorld::MakeSurface(const Quad& given, uint64_t id) const {
  // ORB turns with the picture: one upside down needs no corners of its own.
  const Quad quad = given.window.v1 < given.window.v0 ? HalfTurned(given) : given;
  FeatureSurface surface;
  surface.corner_world = quad.corner_world;
  surface.edge_u_world = quad.edge_u_world;
  surface.edge_v_world = quad.edge_v_world;
  surface.normal_world = quad.NormalWorld();
  surface.length_u_m = quad.edge_u_world.norm();
  surface.length_v_m = quad.edge_v_world.norm();
  const TextureWindow& window = quad.window;
  const bool flip_u = window.u1 < window.u0;
  surface.span = {std::abs(window.u1 - window.u0), window.v1 - window.v0};
  surface.start = {flip_u ? 1 - window.u0 : window.u0, window.v0};
  const double texel_u_m = surface.length_u_m / (surface.span.x() * quad.texture->width());
  const double texel_v_m = surface.length_v_m / (surface.span.y() * quad.texture->height());
  surface.picture = PictureOf(quad, std::log(texel_u_m / texel_v_m));
  surface.light = quad.light;
  surface.id = id;
  surface.object_id = quad.object_id;
  return surface;
}

/// As WorldRenderer lights it. A world without lights has textures that hold their light.
std::shared_ptr<const Scene> FeatureWorld::LitScene(int64_t stamp_ns) const {
  auto scene = std::make_shared<Scene>(SceneAt(*world_, stamp_ns));
  if (!world_->lights.empty()) BakeLights(*scene, world_->lights, world_->ambient);
  return scene;
}

std::shared_ptr<const FeatureScene> FeatureWorld::Build(int64_t stamp_ns) const {
  const std::shared_ptr<const Scene> scene = LitScene(stamp_ns);
  auto built = std::make_shared<FeatureScene>();
  built->surfaces.reserve(scene->quads.size());
  std::unordered_map<uint32_t, uint64_t> num_of_object;
  for (const Quad& quad : scene->quads) {
    const uint64_t id = Hash(quad.object_id, num_of_object[quad.object_id]++);
    built->surfaces.push_back(MakeSurface(quad, id));
  }
  Complete(*built);
  built->rays = std::make_unique<const SceneRays>(scene);
  return built;
}

std::shared_ptr<const FeatureScene> FeatureWorld::At(int64_t stamp_ns) const {
  const auto after = std::upper_bound(change_stamps_ns_.begin(), change_stamps_ns_.end(), stamp_ns);
  const auto num_changes = static_cast<size_t>(after - change_stamps_ns_.begin());
  {
    MutexLock lock(mutex_);
    const auto found = scenes_.find(num_changes);
    if (found != scenes_.end()) return found->second;
  }
  // Two threads may build the same; the first one's stays.
  const std::shared_ptr<const FeatureScene> built = Build(stamp_ns);
  MutexLock lock(mutex_);
  return scenes_.emplace(num_changes, built).first->second;
}

std::shared_ptr<const FeatureScene> FeatureWorld::PassersAt(int64_t stamp_ns) const {
  if (world_->passers.empty()) return nullptr;
  const auto scene = std::make_shared<const Scene>(Scene{sim::PassersAt(*world_, stamp_ns)});
  auto passers = std::make_shared<FeatureScene>();
  for (const Quad& quad : scene->quads) {
    passers->surfaces.push_back(MakeSurface(quad, Hash(kPasserTag, passers->surfaces.size())));
  }
  Complete(*passers);
  passers->rays = std::make_unique<const SceneRays>(scene);
  return passers;
}

}  // namespace mapp::sim
