#pragma once

#include "sim/renderer.h"

#include <cstdint>
#include <span>

namespace mapp::sim {

/// What a real camera adds to a rendered frame. Zero everywhere gives the exact frame.
struct SensorNoise {
  /// Standard deviation of the gray level.
  double gray_sigma = 2.0;
  /// Standard deviation of depth is this times z^2, 1/m. Source: the depth noise of structured light, about
  /// 1.4e-3 for the first Kinect (Khoshelham and Elberink, Sensors 2012), with some smoothing.
  double depth_sigma_per_m = 0.0012;
  /// No reading beyond, metres; infinity keeps all.
  double max_depth_m = 8.0;
};

/// Adds noise in place; the same seed gives the same noise.
void AddSensorNoise(const SensorNoise& noise, uint64_t seed, RenderedFrame& frame);

/// Multiplies gray and colour, as a longer exposure would; what becomes brighter than 255 is white. `gain` >= 0.
void ApplyGain(double gain, RenderedFrame& frame);

/// A frame blurred by motion: the mean of the gray levels and colours seen from `T_world_camera`, the poses at evenly
/// spaced times while the shutter is open, at least one. Depth is that of the middle pose: depth cameras expose for
/// less time. Errors as Renderer::Render(); INVALID_ARGUMENT without a pose.
StatusOr<RenderedFrame> RenderWithMotionBlur(const Renderer& renderer, const Camera& camera,
                                             std::span<const Pose3> T_world_camera, std::span<const Quad> moving_quads);

}  // namespace mapp::sim
