#include "vision/pose_optimizer.h"

#include "vision/reprojection.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kMinInliers = 6;

struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
};

class PoseProblem {
 public:
  PoseProblem(const PinholeCamera& camera, std::span<const PoseObservation> observations, const PoseOptions& options)
      : camera_(camera), observations_(observations), options_(options), active_(observations.size()) {
    for (size_t i = 0; i < observations.size(); ++i) active_[i] = IsUsable(observations[i]);
  }

  const std::vector<bool>& active() const { return active_; }
  int num_active() const { return static_cast<int>(std::count(active_.begin(), active_.end(), true)); }

  double Bound(const PoseObservation& observation) const {
    return observation.depth_m > 0 ? options_.chi2_depth : options_.chi2_mono;
  }

  /// Sum of (robust) squared residuals of the active observations.
  double Cost(const Pose3& T_world_camera, bool robust) const {
    const Pose3 T_camera_world = T_world_camera.Inverse();
    const Eigen::Matrix3d R_camera_world = T_camera_world.RotationMatrix();
    double cost = 0;
    for (size_t i = 0; i < observations_.size(); ++i) {
      if (!active_[i]) continue;
      const PoseObservation& observation = observations_[i];
      const Eigen::Vector3d p_camera = R_camera_world * observation.p_world + T_camera_world.translation();
      const double bound = Bound(observation);
      if (p_camera.z() < internal::kMinDepth_m) {
        cost += internal::kBehindCameraPenalty * bound;
        continue;
      }
      const double chi2 = Residual(observation, p_camera).squaredNorm();
      // Huber with its corner at the chi-square bound.
      cost += robust && chi2 > bound ? 2.0 * std::sqrt(bound * chi2) - bound : chi2;
    }
    return cost;
  }

  NormalEquations Linearize(const Pose3& T_world_camera, bool robust) const {
    const Pose3 T_camera_world = T_world_camera.Inverse();
    const Eigen::Matrix3d R_camera_world = T_camera_world.RotationMatrix();
    NormalEquations normal;
    for (size_t i = 0; i < observations_.size(); ++i) {
      if (!active_[i]) continue;
      const PoseObservation& observation = observations_[i];
      const Eigen::Vector3d p_camera = R_camera_world * observation.p_world + T_camera_world.translation();
      if (p_camera.z() < internal::kMinDepth_m) continue;
      const Eigen::Vector3d residual = Residual(observation, p_camera);
      const Eigen::Matrix<double, 3, 6> jacobian =
          internal::ByPose(internal::ReprojectionByPoint(camera_, Measured(observation), p_camera), p_camera);
      const double chi2 = residual.squaredNorm();
      const double bound = Bound(observation);
      const double weight = robust && chi2 > bound ? std::sqrt(bound / chi2) : 1.0;
      normal.hessian.noalias() += weight * jacobian.transpose() * jacobian;
      normal.gradient.noalias() += weight * jacobian.transpose() * residual;
    }
    return normal;
  }

  /// Makes active exactly those observations within their bound at this pose; earlier outliers may return.
  void Classify(const Pose3& T_world_camera) {
    const Pose3 T_camera_world = T_world_camera.Inverse();
    for (size_t i = 0; i < observations_.size(); ++i) {
      const PoseObservation& observation = observations_[i];
      const Eigen::Vector3d p_camera = T_camera_world * observation.p_world;
      active_[i] = IsUsable(observation) && p_camera.z() >= internal::kMinDepth_m &&
                   Residual(observation, p_camera).squaredNorm() <= Bound(observation);
    }
  }

  double InlierRmse(const Pose3& T_world_camera) const {
    const Pose3 T_camera_world = T_world_camera.Inverse();
    double sum = 0;
    int count = 0;
    for (size_t i = 0; i < observations_.size(); ++i) {
      if (!active_[i]) continue;
      sum += Residual(observations_[i], T_camera_world * observations_[i].p_world).head<2>().squaredNorm();
      ++count;
    }
    return count > 0 ? std::sqrt(sum / count) : 0.0;
  }

 private:
  static bool IsUsable(const PoseObservation& observation) {
    return observation.p_world.allFinite() && observation.pixel.allFinite() && observation.sigma_px > 0 &&
           std::isfinite(observation.sigma_px) && std::isfinite(observation.depth_m);
  }

  internal::ReprojectionMeasurement Measured(const PoseObservation& observation) const {
    return {observation.pixel, observation.sigma_px, observation.depth_m, options_.bf_px_m};
  }

  Eigen::Vector3d Residual(const PoseObservation& observation, const Eigen::Vector3d& p_camera) const {
    return internal::ReprojectionError(camera_, Measured(observation), p_camera);
  }

  const PinholeCamera& camera_;
  std::span<const PoseObservation> observations_;
  const PoseOptions& options_;
  std::vector<bool> active_;
};

/// Levenberg-Marquardt with Marquardt's scaling over the active observations. False when no descent was possible
/// although the step was not negligible.
bool Minimize(const PoseProblem& problem, bool robust, int max_iterations, Pose3& T_world_camera) {
  constexpr double kMinRelativeDecrease = 1e-6;
  constexpr double kMinStep = 1e-9;
  constexpr double kMaxLambda = 1e8;
  double lambda = 1e-4;
  double cost = problem.Cost(T_world_camera, robust);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    const NormalEquations normal = problem.Linearize(T_world_camera, robust);
    bool accepted = false;
    double decrease = 0;
    while (!accepted) {
      Matrix6d damped = normal.hessian;
      damped.diagonal() *= 1.0 + lambda;
      const Eigen::LLT<Matrix6d> llt(damped);
      if (llt.info() == Eigen::Success) {
        const Vector6d step = -llt.solve(normal.gradient);
        if (step.norm() < kMinStep) return true;
        const Pose3 candidate = T_world_camera * Pose3::Exp(step);
        const double candidate_cost = problem.Cost(candidate, robust);
        if (candidate_cost < cost) {
          accepted = true;
          decrease = cost - candidate_cost;
          cost = candidate_cost;
          T_world_camera = candidate;
          lambda = std::max(lambda * 0.1, 1e-9);
          continue;
        }
        // At the minimum rounding alone decides: a gain this small is none.
        if (-normal.gradient.dot(step) <= kMinRelativeDecrease * cost) return true;
      }
      lambda *= 10.0;
      if (lambda > kMaxLambda) return false;
    }
    if (decrease <= kMinRelativeDecrease * cost) return true;
  }
  return true;
}

}  // namespace

PoseResult OptimizePose(const PinholeCamera& camera, std::span<const PoseObservation> observations,
                        const Pose3& T_world_camera, const PoseOptions& options) {
  PoseResult result;
  result.T_world_camera = T_world_camera;
  result.inliers.assign(observations.size(), false);
  PoseProblem problem(camera, observations, options);
  if (!T_world_camera.IsFinite() || problem.num_active() < kMinInliers) return result;

  constexpr int kPlainRounds = 2;
  bool descended = false;
  for (int round = 0; round < options.rounds; ++round) {
    const bool robust = round < options.rounds - kPlainRounds;
    descended = Minimize(problem, robust, options.iterations_per_round, result.T_world_camera);
    problem.Classify(result.T_world_camera);
    if (problem.num_active() < kMinInliers) break;
  }
  result.inliers = problem.active();
  result.num_inliers = problem.num_active();
  result.rmse_px = problem.InlierRmse(result.T_world_camera);
  result.converged = descended && result.num_inliers >= kMinInliers && result.T_world_camera.IsFinite();
  result.information = problem.Linearize(result.T_world_camera, /*robust=*/false).hessian;
  return result;
}

}  // namespace mapp
