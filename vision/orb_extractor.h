#pragma once

#include "mapp/base/status.h"
#include "mapp/feature/feature.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/image/image.h"

#include <memory>
#include <vector>

namespace mapp {

struct OrbExtractorOptions {
  /// Features kept per image. Range [50, kMaxFeatures].
  int num_features = kMaxFeatures;
  /// FAST threshold first tried in a cell, gray levels. Source: Mur-Artal et al., T-RO 2015.
  int fast_threshold = 20;
  /// Tried in cells where the first finds nothing, so that plain walls keep some corners.
  int min_fast_threshold = 7;
  /// Edge of the cells in which the second threshold may be tried, pixels at each level. Range [16, 512].
  int cell_px = 35;
};

/// ORB corners spread over the image: FAST per cell and pyramid level, the strongest of each region first, oriented by
/// intensity centroid, described by rotated BRIEF on the blurred level (Rublee et al. 2011; cells with a second
/// threshold as in ORB-SLAM, Mur-Artal et al. 2015).
/// One thread only: keeps its pyramid buffers between images.
class OrbExtractor {
 public:
  static StatusOr<std::unique_ptr<OrbExtractor>> Create(const OrbExtractorOptions& options);
  ~OrbExtractor();
  OrbExtractor(const OrbExtractor&) = delete;
  OrbExtractor& operator=(const OrbExtractor&) = delete;

  /// Features in pixels of the given image. INVALID_ARGUMENT for an image below 64 pixels an edge.
  StatusOr<std::vector<Feature>> Extract(ImageView<uint8_t> image);

  /// What its features can be compared with.
  FeatureSettings feature_settings() const;

 private:
  struct Impl;
  explicit OrbExtractor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
