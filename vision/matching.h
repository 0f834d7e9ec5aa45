#pragma once

#include "mapp/feature/feature.h"

#include <span>
#include <vector>

namespace mapp {

struct Match {
  int query_idx = 0;
  int train_idx = 0;
  int distance = 0;  ///< Hamming
};

struct MatchOptions {
  /// Greatest Hamming distance of a match. Source: 50 strict, 100 loose in Mur-Artal et al. 2015.
  int max_distance = 64;
  /// Best distance must be below ratio * second best (Lowe 2004). 1 turns the test off.
  double max_ratio = 0.8;
  /// Keep only pairs that choose each other.
  bool mutual = true;
};

/// Exhaustive 2-nearest-neighbour matching, popcount kernel; about 1.2 ms for 1000 x 1000.
std::vector<Match> MatchDescriptors(std::span<const OrbDescriptor> query, std::span<const OrbDescriptor> train,
                                    const MatchOptions& options);

/// Keypoints of one image in cells, for look-ups by position. Positions that are not finite are never found.
class FeatureGrid {
 public:
  /// Position in pixels, distorted or undistorted as the later questions are: the caller's choice.
  struct Point {
    float u_px, v_px;
  };
  FeatureGrid() = default;
  FeatureGrid(std::span<const Point> points, int width_px, int height_px, int cell_px = 24);
  /// Appends indices of points within `radius_px` (square window) of (u, v) to `out`.
  void Find(float u_px, float v_px, float radius_px, std::vector<int>& out) const;

 private:
  std::vector<Point> points_;
  std::vector<int> cell_start_, cell_items_;
  int cell_px_ = 24, columns_ = 0, rows_ = 0;
};

/// A map point as it should appear in an image.
struct ProjectedPoint {
  float u_px = 0, v_px = 0;
  float radius_px = 0;
  int octave = 0;  ///< predicted pyramid level; features within one level of it are considered
  OrbDescriptor descriptor;
};

/// Best feature of each projected point within its radius: octave in [octave - 1, octave + 1], ratio test only among
/// features of the same octave, each feature taken at most once (by the nearest descriptor).
/// `features` are those at the grid's points, in their order. query_idx indexes `projected`, train_idx the features.
std::vector<Match> MatchProjected(std::span<const ProjectedPoint> projected, const FeatureGrid& grid,
                                  std::span<const Feature> features, const MatchOptions& options);

/// Keeps matches whose orientation change agrees with one of the three main bins of 30 (Mur-Artal et al. 2015).
std::vector<Match> FilterByRotation(const std::vector<Match>& matches, std::span<const Feature> query,
                                    std::span<const Feature> train);

/// Pyramid level at which a point of `reference_distance_m` is detected from `distance_m`, clamped to the pyramid.
int PredictOctave(float reference_distance_m, float distance_m);

/// Index of the descriptor with the least median distance to the others; 0 for a single one.
size_t RepresentativeDescriptor(std::span<const OrbDescriptor> descriptors);

}  // namespace mapp
