#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// Two images' sight of what should be one point.
struct TwoViewMatch {
  Eigen::Vector2d first;   ///< undistorted pixel
  Eigen::Vector2d second;  ///< undistorted pixel
  double sigma_px = 1.0;   ///< of either: 1.2^octave
};

struct TwoViewOptions {
  int min_points = 60;  ///< triangulated with `min_parallax`; also the fewest matches worth trying
  /// Angle between the rays to a point below which it does not count: its depth is uncertain by a quarter and more.
  double min_parallax_rad = 0.0175;  ///< Source: 1 degree, Mur-Artal et al. 2015, section IV
  /// Of the matches that fit the motion, how many one rotation may explain within the noise: beyond, the camera's
  /// centre has hardly moved.
  double max_rotation_share = 0.75;
  /// How well the direction of the motion must be known, one sigma. Source: 0.03 where recorded sequences begin.
  double max_direction_sigma_rad = 0.05;
  /// How much worse every other motion must fit the matches: chi-square, 1 degree of freedom a match, at most 3.84
  /// each. A plane seen from two places allows two motions; what tells them apart is what lies off the plane, or a
  /// third view.
  double min_rival_chi2 = 20;
};

enum class TwoViewModel { kHomography, kEssential };

struct TwoViewGeometry {
  TwoViewModel model = TwoViewModel::kEssential;
  Pose3 T_first_second;  ///< the distance between the cameras is 1: two views do not tell it
  /// Per match; absent where it fits the motion badly, lies behind a camera or is seen under too little parallax.
  std::vector<std::optional<Eigen::Vector3d>> points_first;
  int num_points = 0;
  double median_parallax_rad = 0;  ///< of the points
};

/// Motion and structure from two images of one calibrated camera. A homography and an essential matrix by RANSAC give
/// motions; each is refined on all matches by the same measure (Sampson's distance), and the best is chosen of those
/// that place the matches before both cameras. Unlike Mur-Artal et al. (2015, section IV), who choose between the
/// models by their scores, this takes nothing for a plane that has something before it. nullopt, a normal outcome,
/// where the views do not tell: too few matches, hardly any motion or a mere rotation, or another motion that fits as
/// well. About 15 ms for 400 matches; up to 100 ms where half of them are false. Thread-safe: no shared state.
std::optional<TwoViewGeometry> EstimateTwoViewGeometry(const PinholeCamera& camera,
                                                       std::span<const TwoViewMatch> matches,
                                                       const TwoViewOptions& options);

/// The share of the matches that the best rotation about the camera's centre explains within the noise.
double RotationShare(const PinholeCamera& camera, std::span<const TwoViewMatch> matches);

/// Point nearest to both rays (mid-point method), directions of unit length; nullopt where the cosine between them is
/// above `max_cosine`.
std::optional<Eigen::Vector3d> IntersectRays(const Eigen::Vector3d& origin_a, const Eigen::Vector3d& direction_a,
                                             const Eigen::Vector3d& origin_b, const Eigen::Vector3d& direction_b,
                                             double max_cosine);

}  // namespace mapp
