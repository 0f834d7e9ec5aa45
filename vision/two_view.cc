#include "vision/two_view.h"

#include "vision/reprojection.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// chi-square bound at 95 % of a distance from a line, 1 degree of freedom.
constexpr double kChi2Line = 3.841;
constexpr double kRansacConfidence = 0.999;
constexpr int kRansacIterations = 300;  ///< enough for four false matches in ten; a third of a millisecond each
/// Rays this near to parallel come from anywhere beyond.
constexpr double kFarSigmas = 3.0;
/// Of the matches that fit a motion, how many must be able to lie before both cameras.
constexpr double kMinFrontShare = 0.95;
/// Directions of motion that are the same for our purposes.
constexpr double kSameDirectionRad = 0.2;

cv::Matx33d CameraMatrix(const PinholeCamera& camera) {
  return {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
}

Eigen::Matrix3d ToEigen(const cv::Mat& matrix) {
  Eigen::Matrix3d result;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) result(row, column) = matrix.at<double>(row, column);
  }
  return result;
}

Eigen::Matrix3d CameraMatrixOf(const PinholeCamera& camera) {
  Eigen::Matrix3d matrix;
  matrix << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  return matrix;
}

/// A motion by what takes points of the first camera to the second, the translation of length 1.
struct Motion {
  Eigen::Quaterniond R_second_first;
  Eigen::Vector3d t_second_first;

  /// d = [translation on the sphere; rotation vector], in this order.
  Motion Moved(const Eigen::Matrix<double, 5, 1>& d) const {
    const Eigen::Vector3d other =
        std::abs(t_second_first.x()) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
    const Eigen::Vector3d u = t_second_first.cross(other).normalized();
    const Eigen::Vector3d v = t_second_first.cross(u);
    return {(R_second_first * ExpSo3(d.tail<3>())).normalized(), (t_second_first + d[0] * u + d[1] * v).normalized()};
  }
  Pose3 T_first_second() const { return Pose3(R_second_first, t_second_first).Inverse(); }
};

/// How far the matches are from the epipolar lines of a motion: Sampson's distance, in sigmas.
class EpipolarError {
 public:
  EpipolarError(const PinholeCamera& camera, std::span<const TwoViewMatch> matches)
      : K_inverse_(CameraMatrixOf(camera).inverse()), matches_(matches) {}

  Eigen::VectorXd Of(const Motion& motion) const {
    const Eigen::Matrix3d F =
        K_inverse_.transpose() * Skew(motion.t_second_first) * motion.R_second_first.toRotationMatrix() * K_inverse_;
    Eigen::VectorXd errors(static_cast<Eigen::Index>(matches_.size()));
    for (size_t i = 0; i < matches_.size(); ++i) {
      const Eigen::Vector3d line = F * matches_[i].first.homogeneous();
      const Eigen::Vector3d line_first = F.transpose() * matches_[i].second.homogeneous();
      const double norm = std::sqrt(line.head<2>().squaredNorm() + line_first.head<2>().squaredNorm());
      errors[static_cast<Eigen::Index>(i)] =
          matches_[i].second.homogeneous().dot(line) / (std::max(norm, 1e-12) * matches_[i].sigma_px);
    }
    return errors;
  }

 private:
  Eigen::Matrix3d K_inverse_;
  std::span<const TwoViewMatch> matches_;
};

/// Squared errors, none more than the bound.
double Cost(const Eigen::VectorXd& errors) { return errors.array().square().min(kChi2Line).sum(); }

/// Gauss-Newton on the matches within the bound.
struct RefinedMotion {
  Motion motion;
  double cost = 0;
  double sigma_translation = 0;  ///< rad: how well the direction is known, at its worst
};
RefinedMotion Refine(const EpipolarError& error, const Motion& start) {
  constexpr int kIterations = 12;
  constexpr double kStep = 1e-6;
  RefinedMotion best{start, Cost(error.Of(start)), 0};
  Eigen::Matrix<double, 5, 5> information = Eigen::Matrix<double, 5, 5>::Identity();
  double damping = 1e-3;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Eigen::VectorXd errors = error.Of(best.motion);
    Eigen::Matrix<double, Eigen::Dynamic, 5> jacobian(errors.size(), 5);
    for (int k = 0; k < 5; ++k) {
      jacobian.col(k) = (error.Of(best.motion.Moved(kStep * Eigen::Matrix<double, 5, 1>::Unit(k))) - errors) / kStep;
    }
    const Eigen::VectorXd weights = (errors.array().square() < kChi2Line).cast<double>();
    information = jacobian.transpose() * weights.asDiagonal() * jacobian;
    const Eigen::Matrix<double, 5, 1> gradient = jacobian.transpose() * weights.cwiseProduct(errors);
    Eigen::Matrix<double, 5, 5> damped = information;
    damped.diagonal() *= 1 + damping;
    const Motion moved = best.motion.Moved(-damped.ldlt().solve(gradient));
    const double cost = Cost(error.Of(moved));
    if (cost < best.cost) {
      const bool converged = best.cost - cost < 1e-4 * best.cost;
      best.motion = moved;
      best.cost = cost;
      damping *= 0.1;
      if (converged) break;
    } else {
      damping *= 10;
    }
  }
  const Eigen::Matrix<double, 5, 5> covariance = information.inverse();
  best.sigma_translation = std::sqrt(std::max(covariance(0, 0), covariance(1, 1)));
  return best;
}

struct Pixels {
  std::vector<cv::Point2d> first, second;
};

Pixels PixelsOf(std::span<const TwoViewMatch> matches) {
  Pixels pixels;
  for (const TwoViewMatch& match : matches) {
    pixels.first.emplace_back(match.first.x(), match.first.y());
    pixels.second.emplace_back(match.second.x(), match.second.y());
  }
  return pixels;
}

/// What a motion makes of the matches.
struct Structure {
  std::vector<std::optional<Eigen::Vector3d>> points_first;
  std::vector<double> parallaxes;  ///< of the points
  int num_inliers = 0;             ///< near their epipolar lines
  int num_in_front = 0;            ///< of them those that can lie before both cameras, the farthest included
};

class Reconstructor {
 public:
  Reconstructor(const PinholeCamera& camera, std::span<const TwoViewMatch> matches, double min_parallax_rad)
      : camera_(camera), matches_(matches), min_parallax_rad_(min_parallax_rad) {}

  Structure Reconstruct(const Pose3& T_first_second, const Eigen::VectorXd& errors) const {
    Structure structure;
    structure.points_first.resize(matches_.size());
    for (size_t i = 0; i < matches_.size(); ++i) {
      const double error = errors[static_cast<Eigen::Index>(i)];
      if (error * error > kChi2Line) continue;
      ++structure.num_inliers;
      Place(i, T_first_second, structure);
    }
    return structure;
  }

 private:
  void Place(size_t i, const Pose3& T_first_second, Structure& structure) const {
    const TwoViewMatch& match = matches_[i];
    const Eigen::Vector3d d_first = camera_.Unproject(match.first).normalized();
    const Eigen::Vector3d d_second = T_first_second.rotation() * camera_.Unproject(match.second).normalized();
    const double parallax = std::atan2(d_first.cross(d_second).norm(), d_first.dot(d_second));
    // Of what is so far that its rays are parallel within the noise, noise alone says whether they meet before or
    // behind the cameras.
    if (parallax < kFarSigmas * match.sigma_px / camera_.fx) {
      ++structure.num_in_front;
      return;
    }
    const auto point = IntersectRays(Eigen::Vector3d::Zero(), d_first, T_first_second.translation(), d_second, 1.0);
    if (!point || point->z() <= 0 || (T_first_second.Inverse() * *point).z() <= 0) return;
    ++structure.num_in_front;
    if (parallax < min_parallax_rad_) return;
    structure.points_first[i] = *point;
    structure.parallaxes.push_back(parallax);
  }

  const PinholeCamera& camera_;
  std::span<const TwoViewMatch> matches_;
  const double min_parallax_rad_;
};

struct Candidate {
  TwoViewModel model;
  Motion motion;
};

Motion FromOpenCv(const cv::Mat& R_second_first, const cv::Mat& t_second_first) {
  const Eigen::Vector3d t(t_second_first.at<double>(0), t_second_first.at<double>(1), t_second_first.at<double>(2));
  return {Eigen::Quaterniond(ToEigen(R_second_first)), t.normalized()};
}

void AddMotionsOfHomography(const Pixels& pixels, const PinholeCamera& camera, std::vector<Candidate>& candidates) {
  const cv::Mat H = cv::findHomography(pixels.first, pixels.second, cv::RANSAC, std::sqrt(internal::kChi2Mono),
                                       cv::noArray(), kRansacIterations, kRansacConfidence);
  if (H.empty()) return;
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, CameraMatrix(camera), rotations, translations, normals);
  for (size_t i = 0; i < rotations.size(); ++i) {
    if (cv::norm(translations[i]) == 0) continue;  // a rotation: no motion of the centre to speak of
    candidates.push_back({TwoViewModel::kHomography, FromOpenCv(rotations[i], translations[i])});
  }
}

void AddMotionsOfEssential(const Pixels& pixels, const PinholeCamera& camera, std::vector<Candidate>& candidates) {
  const cv::Mat E = cv::findEssentialMat(pixels.first, pixels.second, CameraMatrix(camera), cv::RANSAC,
                                         kRansacConfidence, std::sqrt(kChi2Line), kRansacIterations);
  if (E.rows != 3) return;  // none, or several of one sample that nothing else supports
  cv::Mat R_a, R_b, t;
  cv::decomposeEssentialMat(E, R_a, R_b, t);
  const cv::Mat minus_t = -t;
  for (const cv::Mat& R : {R_a, R_b}) {
    candidates.push_back({TwoViewModel::kEssential, FromOpenCv(R, t)});
    candidates.push_back({TwoViewModel::kEssential, FromOpenCv(R, minus_t)});
  }
}

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// A candidate after refinement on all matches.
struct Solution {
  TwoViewModel model;
  RefinedMotion refined;
  Structure structure;
};

std::vector<Solution> Solve(const PinholeCamera& camera, std::span<const TwoViewMatch> matches,
                            const TwoViewOptions& options) {
  const Pixels pixels = PixelsOf(matches);
  std::vector<Candidate> candidates;
  AddMotionsOfHomography(pixels, camera, candidates);
  AddMotionsOfEssential(pixels, camera, candidates);
  const EpipolarError error(camera, matches);
  const Reconstructor reconstructor(camera, matches, options.min_parallax_rad);
  std::vector<Solution> solutions;
  for (const Candidate& candidate : candidates) {
    Solution solution{candidate.model, Refine(error, candidate.motion), {}};
    const Motion& motion = solution.refined.motion;
    solution.structure = reconstructor.Reconstruct(motion.T_first_second(), error.Of(motion));
    const Structure& structure = solution.structure;
    if (structure.num_in_front < kMinFrontShare * structure.num_inliers) continue;
    solutions.push_back(std::move(solution));
  }
  std::stable_sort(solutions.begin(), solutions.end(),
                   [](const Solution& a, const Solution& b) { return a.refined.cost < b.refined.cost; });
  return solutions;
}

bool IsSameMotion(const Motion& a, const Motion& b) {
  return a.t_second_first.dot(b.t_second_first) > std::cos(kSameDirectionRad);
}

std::optional<TwoViewGeometry> Choose(std::vector<Solution> solutions, double num_by_rotation,
                                      const TwoViewOptions& options) {
  if (solutions.empty()) return std::nullopt;
  Solution& best = solutions.front();
  const auto num_points = static_cast<int>(best.structure.parallaxes.size());
  if (num_points < options.min_points || best.refined.sigma_translation > options.max_direction_sigma_rad) {
    return std::nullopt;
  }
  if (num_by_rotation > options.max_rotation_share * best.structure.num_inliers) return std::nullopt;
  for (const Solution& rival : solutions) {
    if (IsSameMotion(rival.refined.motion, best.refined.motion)) continue;
    if (rival.refined.cost < best.refined.cost + options.min_rival_chi2) return std::nullopt;
  }
  TwoViewGeometry geometry;
  geometry.model = best.model;
  geometry.T_first_second = best.refined.motion.T_first_second();
  geometry.points_first = std::move(best.structure.points_first);
  geometry.num_points = num_points;
  geometry.median_parallax_rad = Median(std::move(best.structure.parallaxes));
  return geometry;
}

}  // namespace

std::optional<TwoViewGeometry> EstimateTwoViewGeometry(const PinholeCamera& camera,
                                                       std::span<const TwoViewMatch> matches,
                                                       const TwoViewOptions& options) {
  if (static_cast<int>(matches.size()) < options.min_points) return std::nullopt;
  const double rotation_share = RotationShare(camera, matches);
  if (rotation_share > options.max_rotation_share) return std::nullopt;
  try {
    return Choose(Solve(camera, matches, options), rotation_share * static_cast<double>(matches.size()), options);
  } catch (const cv::Exception&) {
    return std::nullopt;  // A degenerate set: all matches on a line or in one place.
  }
}

double RotationShare(const PinholeCamera& camera, std::span<const TwoViewMatch> matches) {
  if (matches.empty()) return 0;
  // Absolute errors, minimised by weighting anew: false matches and near points then turn nothing.
  constexpr int kRounds = 10;
  constexpr double kLeastError = 1e-4;
  Eigen::Quaterniond R_second_first = Eigen::Quaterniond::Identity();
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const TwoViewMatch& match : matches) {
      const Eigen::Vector3d d_first = camera.Unproject(match.first).normalized();
      const Eigen::Vector3d d_second = camera.Unproject(match.second).normalized();
      const double error = round == 0 ? 1 : (d_second - R_second_first * d_first).norm();
      sum += d_second * d_first.transpose() / std::max(error, kLeastError);
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d mirror = Eigen::Matrix3d::Identity();
    mirror(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant();
    R_second_first = Eigen::Quaterniond(svd.matrixU() * mirror * svd.matrixV().transpose());
  }
  size_t num_explained = 0;
  for (const TwoViewMatch& match : matches) {
    const Eigen::Vector3d d_second = R_second_first * camera.Unproject(match.first);
    if (d_second.z() <= 0) continue;
    // Both pixels are noisy.
    const double bound = 2 * internal::kChi2Mono * match.sigma_px * match.sigma_px;
    if ((camera.Project(d_second) - match.second).squaredNorm() < bound) ++num_explained;
  }
  return static_cast<double>(num_explained) / static_cast<double>(matches.size());
}

std::optional<Eigen::Vector3d> IntersectRays(const Eigen::Vector3d& origin_a, const Eigen::Vector3d& direction_a,
                                             const Eigen::Vector3d& origin_b, const Eigen::Vector3d& direction_b,
                                             double max_cosine) {
  const double cosine = direction_a.dot(direction_b);
  if (cosine > max_cosine) return std::nullopt;
  const Eigen::Vector3d baseline = origin_b - origin_a;
  const double sine2 = 1 - cosine * cosine;
  const double along_a = (baseline.dot(direction_a) - cosine * baseline.dot(direction_b)) / sine2;
  const double along_b = (cosine * baseline.dot(direction_a) - baseline.dot(direction_b)) / sine2;
  return 0.5 * (origin_a + along_a * direction_a + origin_b + along_b * direction_b);
}

}  // namespace mapp
