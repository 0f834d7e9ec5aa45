#include "sim/world/world_renderer.h"

#include "sim/bake_lights.h"
#include "sim/sensor_noise.h"

#include <algorithm>
#include <utility>

namespace mapp::sim {
namespace {

std::vector<int64_t> ChangeTimes(const World& world) {
  std::vector<int64_t> times_ns;
  for (const WorldChange& change : ChangesOf(world)) times_ns.push_back(change.stamp_ns);
  return times_ns;
}

}  // namespace

WorldRenderer::WorldRenderer(std::shared_ptr<const World> world, int num_threads, bool with_color)
    : world_(std::move(world)),
      change_times_ns_(ChangeTimes(*world_)),
      options_{num_threads, world_->sky_gray, with_color} {}

StatusOr<RenderedFrame> WorldRenderer::Render(const Camera& camera, std::span<const Pose3> T_world_camera,
                                              int64_t stamp_ns) const {
  const std::shared_ptr<const Renderer> renderer = RendererAt(stamp_ns);
  return RenderWithMotionBlur(*renderer, camera, T_world_camera, PassersAt(*world_, stamp_ns));
}

std::shared_ptr<const Renderer> WorldRenderer::RendererAt(int64_t stamp_ns) const {
  const auto later = std::ranges::upper_bound(change_times_ns_, stamp_ns);
  const auto num_before = static_cast<size_t>(later - change_times_ns_.begin());
  const MutexLock lock(mutex_);
  if (renderer_ == nullptr || num_changes_before_ != num_before) {
    auto scene = std::make_shared<Scene>(SceneAt(*world_, stamp_ns));
    BakeLights(*scene, world_->lights, world_->ambient, {.num_threads = options_.num_threads});
    renderer_ = MakeEmbreeRenderer(std::move(scene), options_);
    num_changes_before_ = num_before;
  }
  return renderer_;
}

}  // namespace mapp::sim
