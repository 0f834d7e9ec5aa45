#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "sim/renderer.h"
#include "sim/world/world.h"

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace mapp::sim {

/// Draws a world as it is at any time: its objects where they stand then, lit, and the people who pass. Thread-safe.
class WorldRenderer {
 public:
  /// `world` must not be null; it is shared. `with_color`: frames have colours too.
  WorldRenderer(std::shared_ptr<const World> world, int num_threads, bool with_color);

  /// `T_world_camera`: one pose, or more for a picture blurred by motion; see RenderWithMotionBlur().
  StatusOr<RenderedFrame> Render(const Camera& camera, std::span<const Pose3> T_world_camera, int64_t stamp_ns) const;

 private:
  /// Light and shadows are computed once for each time span without changes; the last one is kept.
  std::shared_ptr<const Renderer> RendererAt(int64_t stamp_ns) const;

  const std::shared_ptr<const World> world_;
  const std::vector<int64_t> change_times_ns_;  ///< by increasing time
  const EmbreeOptions options_;
  mutable Mutex mutex_;
  mutable std::shared_ptr<const Renderer> renderer_ ABSL_GUARDED_BY(mutex_);
  mutable size_t num_changes_before_ ABSL_GUARDED_BY(mutex_) = 0;  ///< the time span that renderer_ shows
};

}  // namespace mapp::sim
