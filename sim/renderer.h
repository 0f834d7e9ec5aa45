#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"
#include "sim/scene.h"

#include <memory>

namespace mapp::sim {

struct RenderedFrame {
  GrayImage gray;
  DepthImage depth_m;  ///< along the optical axis; 0 where nothing is hit
};

/// Draws a scene without sensor noise. Implementations are thread-safe and deterministic.
class Renderer {
 public:
  virtual ~Renderer() = default;
  /// INVALID_ARGUMENT: a camera that Camera::Validate() refuses or whose model the implementation does not draw.
  virtual StatusOr<RenderedFrame> Render(const Camera& camera, const Pose3& T_world_camera) const = 0;
};

/// Scan-line renderer for scenes of some hundred rectangles and pinhole cameras: 2 x 2 samples a pixel, trilinear
/// textures. `num_threads` share a frame; the picture does not depend on it. `scene` must not be null.
std::unique_ptr<Renderer> MakeRasterRenderer(std::shared_ptr<const Scene> scene, int num_threads);

}  // namespace mapp::sim
