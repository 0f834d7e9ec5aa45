#include "vision/robust_estimators.h"

#include "mapp/base/rng.h"
#include "vision/pose_optimizer.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace mapp {
namespace {

constexpr int kSampleSize = 3;
using Sample = std::array<size_t, kSampleSize>;

Sample DrawSample(size_t count, Rng& rng) {
  Sample sample{};
  sample[0] = rng.Below(count);
  do sample[1] = rng.Below(count);
  while (sample[1] == sample[0]);
  do sample[2] = rng.Below(count);
  while (sample[2] == sample[0] || sample[2] == sample[1]);
  return sample;
}

/// Samples needed to draw an all-inlier one with the wished probability (Fischler and Bolles 1981).
int RequiredIterations(int num_inliers, size_t count, const RansacOptions& options) {
  const double good_share = std::pow(static_cast<double>(num_inliers) / static_cast<double>(count), kSampleSize);
  if (good_share >= 1.0) return 1;
  const double needed = std::log1p(-options.success_probability) / std::log1p(-good_share);
  return needed < options.max_iterations ? static_cast<int>(std::ceil(needed)) : options.max_iterations;
}

int RequiredInliers(const RansacOptions& options) { return std::max(options.min_inliers, kSampleSize); }

// ---- Rigid motion and similarity ----

struct PointPairs {
  std::span<const Eigen::Vector3d> source;
  std::span<const Eigen::Vector3d> target;
  std::span<const double> tolerances_m;
  bool with_scale;
};

/// Twice the area of the sample's triangle over its longest edge squared: 0 when the points are collinear.
double TriangleQuality(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const double longest = std::max({(b - a).squaredNorm(), (c - a).squaredNorm(), (c - b).squaredNorm()});
  return longest > 0 ? (b - a).cross(c - a).norm() / longest : 0.0;
}

/// Whether three pairs can come from one motion. For rigid motion edges keep their lengths, which discards most
/// samples with a false pair before anything is solved.
bool IsPlausible(const PointPairs& pairs, const Sample& sample) {
  // Nearly collinear triples leave the rotation about their line undetermined.
  constexpr double kMinTriangleQuality = 0.05;
  const auto [a, b, c] = sample;
  if (TriangleQuality(pairs.source[a], pairs.source[b], pairs.source[c]) < kMinTriangleQuality) return false;
  if (TriangleQuality(pairs.target[a], pairs.target[b], pairs.target[c]) < kMinTriangleQuality) return false;
  if (pairs.with_scale) return true;
  const auto edge_is_kept = [&](size_t i, size_t j) {
    const double difference = (pairs.source[i] - pairs.source[j]).norm() - (pairs.target[i] - pairs.target[j]).norm();
    return std::abs(difference) <= pairs.tolerances_m[i] + pairs.tolerances_m[j];
  };
  return edge_is_kept(a, b) && edge_is_kept(a, c) && edge_is_kept(b, c);
}

bool IsFinite(const Sim3& transform) {
  return std::isfinite(transform.scale) && transform.scale > 0 && transform.pose.IsFinite();
}

RigidResult Score(const PointPairs& pairs, const Sim3& T_target_source) {
  RigidResult result;
  result.T_target_source = T_target_source;
  result.inliers.resize(pairs.source.size());
  const Eigen::Matrix3d scaled_rotation = T_target_source.scale * T_target_source.pose.RotationMatrix();
  const Eigen::Vector3d& translation = T_target_source.pose.translation();
  for (size_t i = 0; i < pairs.source.size(); ++i) {
    const Eigen::Vector3d error = pairs.target[i] - scaled_rotation * pairs.source[i] - translation;
    const bool agrees = error.squaredNorm() < pairs.tolerances_m[i] * pairs.tolerances_m[i];
    result.inliers[i] = agrees;
    if (agrees) ++result.num_inliers;
  }
  return result;
}

/// Least-squares fit to the inliers of `result`.
Sim3 FitToInliers(const PointPairs& pairs, const RigidResult& result) {
  Eigen::Matrix3Xd source(3, result.num_inliers);
  Eigen::Matrix3Xd target(3, result.num_inliers);
  Eigen::Index column = 0;
  for (size_t i = 0; i < pairs.source.size(); ++i) {
    if (!result.inliers[i]) continue;
    source.col(column) = pairs.source[i];
    target.col(column) = pairs.target[i];
    ++column;
  }
  return AlignPoints(source, target, pairs.with_scale);
}

/// Fits to all inliers as long as that gains some; keeps the best fit seen.
void Refine(const PointPairs& pairs, RigidResult& best) {
  constexpr int kMaxRefinements = 5;
  for (int i = 0; i < kMaxRefinements; ++i) {
    const Sim3 refined = FitToInliers(pairs, best);
    if (!IsFinite(refined)) return;
    RigidResult result = Score(pairs, refined);
    if (result.num_inliers < best.num_inliers) return;
    const bool gained = result.num_inliers > best.num_inliers;
    best = std::move(result);
    if (!gained) return;
  }
}

}  // namespace

std::optional<RigidResult> EstimateRigid(std::span<const Eigen::Vector3d> source,
                                         std::span<const Eigen::Vector3d> target, std::span<const double> tolerances_m,
                                         bool with_scale, const RansacOptions& options) {
  if (source.size() != target.size() || source.size() != tolerances_m.size()) return std::nullopt;
  if (static_cast<int>(source.size()) < RequiredInliers(options)) return std::nullopt;
  const PointPairs pairs{source, target, tolerances_m, with_scale};
  Rng rng(options.seed);
  RigidResult best;
  int required_iterations = options.max_iterations;
  for (int iteration = 0; iteration < required_iterations; ++iteration) {
    const Sample sample = DrawSample(source.size(), rng);
    if (!IsPlausible(pairs, sample)) continue;
    Eigen::Matrix3Xd sample_source(3, kSampleSize);
    Eigen::Matrix3Xd sample_target(3, kSampleSize);
    for (int i = 0; i < kSampleSize; ++i) {
      sample_source.col(i) = source[sample[static_cast<size_t>(i)]];
      sample_target.col(i) = target[sample[static_cast<size_t>(i)]];
    }
    const Sim3 hypothesis = AlignPoints(sample_source, sample_target, with_scale);
    if (!IsFinite(hypothesis)) continue;
    RigidResult result = Score(pairs, hypothesis);
    if (result.num_inliers <= best.num_inliers) continue;
    best = std::move(result);
    if (best.num_inliers >= kSampleSize) Refine(pairs, best);
    required_iterations = std::min(required_iterations, RequiredIterations(best.num_inliers, source.size(), options));
  }
  if (best.num_inliers < RequiredInliers(options)) return std::nullopt;
  return best;
}

// ---- Camera pose ----

namespace {

struct PointPixels {
  const PinholeCamera& camera;
  std::span<const Eigen::Vector3d> p_world;
  std::span<const Eigen::Vector2d> pixels;
  double max_error_px;
};

/// Up to four camera poses that see the sample's points at its pixels. A degenerate sample yields none.
std::vector<Pose3> SolveMinimal(const PointPixels& data, const Sample& sample) {
  cv::Matx<double, kSampleSize, 3> points;
  cv::Matx<double, kSampleSize, 2> rays;
  for (int i = 0; i < kSampleSize; ++i) {
    const size_t idx = sample[static_cast<size_t>(i)];
    const Eigen::Vector3d ray = data.camera.Unproject(data.pixels[idx]);
    for (int k = 0; k < 3; ++k) points(i, k) = data.p_world[idx][k];
    for (int k = 0; k < 2; ++k) rays(i, k) = ray[k];
  }
  std::vector<cv::Vec3d> rotations;
  std::vector<cv::Vec3d> translations;
  try {
    cv::solveP3P(cv::Mat(points), cv::Mat(rays), cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rotations, translations,
                 cv::SOLVEPNP_AP3P);
  } catch (const cv::Exception&) {
    return {};  // No real solution for this sample; the next one is drawn.
  }
  std::vector<Pose3> poses;
  for (size_t i = 0; i < rotations.size(); ++i) {
    const Pose3 T_camera_world(ExpSo3({rotations[i][0], rotations[i][1], rotations[i][2]}),
                               {translations[i][0], translations[i][1], translations[i][2]});
    if (T_camera_world.IsFinite()) poses.push_back(T_camera_world.Inverse());
  }
  return poses;
}

PnpResult Score(const PointPixels& data, const Pose3& T_world_camera) {
  PnpResult result;
  result.T_world_camera = T_world_camera;
  result.inliers.resize(data.p_world.size());
  const Pose3 T_camera_world = T_world_camera.Inverse();
  const Eigen::Matrix3d R_camera_world = T_camera_world.RotationMatrix();
  const double max_squared_error = data.max_error_px * data.max_error_px;
  for (size_t i = 0; i < data.p_world.size(); ++i) {
    const Eigen::Vector3d p_camera = R_camera_world * data.p_world[i] + T_camera_world.translation();
    const bool agrees =
        p_camera.z() > 0 && (data.camera.Project(p_camera) - data.pixels[i]).squaredNorm() <= max_squared_error;
    result.inliers[i] = agrees;
    if (agrees) ++result.num_inliers;
  }
  return result;
}

/// Re-estimates the pose on the inliers of `best` and keeps it when at least as many points then agree.
void Refine(const PointPixels& data, PnpResult& best) {
  std::vector<PoseObservation> observations;
  PoseOptions options;
  options.rounds = 2;
  for (size_t i = 0; i < data.p_world.size(); ++i) {
    if (!best.inliers[i]) continue;
    PoseObservation observation;
    observation.p_world = data.p_world[i];
    observation.pixel = data.pixels[i];
    // So that the optimizer's chi-square bound is the caller's error bound.
    observation.sigma_px = data.max_error_px / std::sqrt(options.chi2_mono);
    observations.push_back(observation);
  }
  const PoseResult refined = OptimizePose(data.camera, observations, best.T_world_camera, options);
  if (!refined.converged) return;
  PnpResult result = Score(data, refined.T_world_camera);
  if (result.num_inliers >= best.num_inliers) best = std::move(result);
}

}  // namespace

std::optional<PnpResult> EstimatePose(const PinholeCamera& camera, std::span<const Eigen::Vector3d> p_world,
                                      std::span<const Eigen::Vector2d> pixels, double max_error_px,
                                      const RansacOptions& options) {
  if (p_world.size() != pixels.size() || !(max_error_px > 0)) return std::nullopt;
  if (static_cast<int>(p_world.size()) < RequiredInliers(options)) return std::nullopt;
  const PointPixels data{camera, p_world, pixels, max_error_px};
  Rng rng(options.seed);
  PnpResult best;
  int required_iterations = options.max_iterations;
  for (int iteration = 0; iteration < required_iterations; ++iteration) {
    for (const Pose3& T_world_camera : SolveMinimal(data, DrawSample(p_world.size(), rng))) {
      PnpResult result = Score(data, T_world_camera);
      if (result.num_inliers > best.num_inliers) best = std::move(result);
    }
    if (best.num_inliers <= kSampleSize) continue;
    required_iterations = std::min(required_iterations, RequiredIterations(best.num_inliers, p_world.size(), options));
  }
  if (best.num_inliers >= kSampleSize) Refine(data, best);
  if (best.num_inliers < RequiredInliers(options)) return std::nullopt;
  return best;
}

}  // namespace mapp
