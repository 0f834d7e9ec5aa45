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

/// A camera's automatic exposure: follows the brightness of what it sees, with delay. One object a camera; frames in
/// the order of their times.
class AutoExposure {
 public:
  struct Options {
    double target_level = 110;  ///< mean gray level aimed at, (0, 255)
    double delay_s = 0.4;       ///< time in which a difference shrinks to 1/e, > 0
    double min_gain = 0.25;
    double max_gain = 4;
  };
  explicit AutoExposure(const Options& options) : options_(options) {}

  /// Exposes the frame (gain 1) with what was learnt from those before it, then learns from it. The first frame is
  /// exposed as it should be.
  void Expose(int64_t stamp_ns, RenderedFrame& frame);
  double gain() const { return gain_; }

 private:
  const Options options_;
  double gain_ = 0;  ///< 0: no frame yet
  int64_t last_stamp_ns_ = 0;
};

/// A frame blurred by motion: the mean of the gray levels and colours seen from `T_world_camera`, the poses at evenly
/// spaced times while the shutter is open, at least one. Depth is that of the middle pose: depth cameras expose for
/// less time. Errors as Renderer::Render(); INVALID_ARGUMENT without a pose.
StatusOr<RenderedFrame> RenderWithMotionBlur(const Renderer& renderer, const Camera& camera,
                                             std::span<const Pose3> T_world_camera, std::span<const Quad> moving_quads);

}  // namespace mapp::sim
