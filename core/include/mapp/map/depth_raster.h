#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

namespace mapp {

/// How far a view looked, square by square of its image: what it measured of places whose features it does not send.
/// With it a frame that was reduced to what is new still tells what has gone, about a byte and a half a square.
struct DepthRaster {
  /// Side of a square. Its centre is off by up to 17 px: at a focal length of 525 px half the radius within which a
  /// measurement counts as the same place (SightingOptions::match_radius).
  static constexpr int kCellPx = 24;
  static constexpr float kMinDepthM = 0.1F;
  static constexpr float kMaxDepthM = 100.0F;

  struct Sample {
    uint32_t cell = 0;  ///< row * number of columns + column
    float depth_m = 0;  ///< least depth measured in the square, along the optical axis

    friend bool operator==(const Sample&, const Sample&) = default;
  };
  std::vector<Sample> samples;  ///< by cell, no cell twice

  friend bool operator==(const DepthRaster&, const DepthRaster&) = default;
};

/// Number of squares that the camera's image is divided into, the last ones of rows and columns cut off.
uint32_t NumRasterCells(const Camera& camera);
uint32_t RasterCellOf(const Camera& camera, const Eigen::Vector2d& pixel);
/// Centre of a square, pixels of the recorded image.
Eigen::Vector2d RasterCellCenter(const Camera& camera, uint32_t cell);

/// Makes the raster of one view.
class DepthRasterizer {
 public:
  explicit DepthRasterizer(const Camera& camera) : camera_(camera) {}
  /// A feature's pixel, in the image, and its depth. Depths that no raster holds are passed over.
  void Add(const Eigen::Vector2d& pixel, float depth_m);
  DepthRaster Finish() const;

 private:
  const Camera& camera_;
  std::map<uint32_t, float> nearest_m_;
};

/// INVALID_ARGUMENT naming the sample: cells that do not ascend or lie outside the image, a depth out of range.
Status Validate(const DepthRaster& raster, const Camera& camera);

}  // namespace mapp
