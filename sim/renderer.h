#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"
#include "sim/scene.h"

#include <array>
#include <cstdint>
#include <memory>
#include <span>

namespace mapp::sim {

/// Red, green, blue.
using ColorImage = Image<std::array<uint8_t, 3>>;

struct RenderedFrame {
  GrayImage gray;
  DepthImage depth_m;  ///< along the optical axis; 0 where nothing is hit
  ColorImage color{};  ///< gray times the surfaces' tint; empty unless asked for
};

/// Draws a scene without sensor noise. Implementations are thread-safe and deterministic.
class Renderer {
 public:
  virtual ~Renderer() = default;
  /// `moving_quads`: surfaces of this frame that are not in the scene, such as people who walk by; world frame.
  /// INVALID_ARGUMENT: a camera that Camera::Validate() refuses or whose model the implementation does not draw.
  virtual StatusOr<RenderedFrame> Render(const Camera& camera, const Pose3& T_world_camera,
                                         std::span<const Quad> moving_quads) const = 0;
  StatusOr<RenderedFrame> Render(const Camera& camera, const Pose3& T_world_camera) const {
    return Render(camera, T_world_camera, {});
  }
};

struct EmbreeOptions {
  int num_threads = 2;      ///< that share a frame, [1, 256]; the picture does not depend on it
  uint8_t sky_gray = 0;     ///< where nothing is hit
  bool with_color = false;  ///< fill RenderedFrame::color
};

/// Ray tracer for scenes of any size and all camera models. Depth is exact for the pixel's centre; gray levels are
/// smoothed at edges and by mip levels. `scene` must not be null; it is shared.
std::unique_ptr<Renderer> MakeEmbreeRenderer(std::shared_ptr<const Scene> scene, const EmbreeOptions& options);

/// Scan-line renderer for scenes of some hundred rectangles and pinhole cameras: 2 x 2 samples a pixel, trilinear
/// textures. `num_threads` share a frame; the picture does not depend on it. `scene` must not be null.
std::unique_ptr<Renderer> MakeRasterRenderer(std::shared_ptr<const Scene> scene, int num_threads);

}  // namespace mapp::sim
