#include "sim/sensor_noise.h"

#include "mapp/base/rng.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

/// Standard normal numbers drawn from a table: ten times as fast as computing each, and as good for pixels.
class NormalTable {
 public:
  explicit NormalTable(uint64_t seed) : rng_(seed) {
    for (float& value : values_) value = static_cast<float>(rng_.Normal());
  }
  float Next() {
    if (left_ == 0) {
      bits_ = rng_.Next();
      left_ = 5;
    }
    --left_;
    const float value = values_[bits_ % values_.size()];
    bits_ >>= 12;
    return value;
  }

 private:
  Rng rng_;
  std::array<float, 4096> values_;
  uint64_t bits_ = 0;
  int left_ = 0;
};

}  // namespace

void AddSensorNoise(const SensorNoise& noise, uint64_t seed, RenderedFrame& frame) {
  NormalTable normal(seed);
  if (noise.gray_sigma > 0) {
    const auto sigma = static_cast<float>(noise.gray_sigma);
    for (uint8_t& level : frame.gray.pixels) {
      const float noisy = static_cast<float>(level) + sigma * normal.Next();
      level = static_cast<uint8_t>(std::clamp(noisy + 0.5F, 0.0F, 255.0F));
    }
  }
  const auto depth_sigma = static_cast<float>(noise.depth_sigma_per_m);
  for (float& depth_m : frame.depth_m.pixels) {
    if (depth_sigma > 0) depth_m += depth_sigma * depth_m * depth_m * normal.Next();
    if (depth_m > noise.max_depth_m) depth_m = 0;
  }
}

void ApplyGain(double gain, RenderedFrame& frame) {
  std::array<uint8_t, 256> exposed;
  for (size_t level = 0; level < exposed.size(); ++level) {
    exposed[level] = static_cast<uint8_t>(std::min(gain * static_cast<double>(level) + 0.5, 255.0));
  }
  for (uint8_t& level : frame.gray.pixels) level = exposed[level];
  for (auto& color : frame.color.pixels) {
    for (uint8_t& level : color) level = exposed[level];
  }
}

StatusOr<RenderedFrame> RenderWithMotionBlur(const Renderer& renderer, const Camera& camera,
                                             std::span<const Pose3> T_world_camera,
                                             std::span<const Quad> moving_quads) {
  if (T_world_camera.empty()) return absl::InvalidArgumentError("T_world_camera: must hold a pose, got none");
  const size_t middle = T_world_camera.size() / 2;
  RenderedFrame blurred;
  std::vector<uint32_t> gray_sums;
  std::vector<std::array<uint32_t, 3>> color_sums;
  for (size_t i = 0; i < T_world_camera.size(); ++i) {
    MAPP_ASSIGN_OR_RETURN(RenderedFrame frame, renderer.Render(camera, T_world_camera[i], moving_quads));
    gray_sums.resize(frame.gray.pixels.size());
    color_sums.resize(frame.color.pixels.size());
    for (size_t p = 0; p < gray_sums.size(); ++p) gray_sums[p] += frame.gray.pixels[p];
    for (size_t p = 0; p < color_sums.size(); ++p) {
      for (size_t channel = 0; channel < 3; ++channel) color_sums[p][channel] += frame.color.pixels[p][channel];
    }
    if (i == middle) blurred = std::move(frame);
  }
  const auto count = static_cast<uint32_t>(T_world_camera.size());
  const auto mean = [count](uint32_t sum) { return static_cast<uint8_t>((sum + count / 2) / count); };
  for (size_t p = 0; p < gray_sums.size(); ++p) blurred.gray.pixels[p] = mean(gray_sums[p]);
  for (size_t p = 0; p < color_sums.size(); ++p) {
    for (size_t channel = 0; channel < 3; ++channel) blurred.color.pixels[p][channel] = mean(color_sums[p][channel]);
  }
  return blurred;
}

}  // namespace mapp::sim
