#pragma once

#include "mapp/geometry/pose3.h"

#include <Eigen/Geometry>
#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <array>
#include <cmath>

// Poses as Ceres sees them. Only for the .cc files of this folder.
namespace mapp::internal {

inline constexpr int kPoseSize = 7;  // x y z, then the quaternion as Eigen stores it: x y z w
using PoseBlock = std::array<double, kPoseSize>;
template <int Rows, int Columns>
using RowMajor = Eigen::Matrix<double, Rows, Columns, Eigen::RowMajor>;

inline Pose3 ToPose(const double* block) {
  return Pose3(Eigen::Quaterniond(Eigen::Map<const Eigen::Quaterniond>(block + 3)),
               Eigen::Map<const Eigen::Vector3d>(block));
}

inline void FromPose(const Pose3& pose, double* block) {
  Eigen::Map<Eigen::Vector3d> translation(block);
  translation = pose.translation();
  Eigen::Map<Eigen::Quaterniond> rotation(block + 3);
  rotation = pose.rotation();
}

/// Plus is the project's right perturbation T Exp(d). The cost functions write their derivative with respect to d into
/// the first six columns of the pose's Jacobian and zero into the last, so PlusJacobian only has to pick those six:
/// cheaper than going through the derivatives by quaternion coefficients and back.
class RightPerturbation final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    FromPose(ToPose(x) * Pose3::Exp(Eigen::Map<const Eigen::Matrix<double, 6, 1>>(delta)), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<RowMajor<kPoseSize, 6>>(jacobian).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 1>> difference(y_minus_x);
    difference = (ToPose(x).Inverse() * ToPose(y)).Log();
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<RowMajor<6, kPoseSize>>(jacobian).setIdentity();
    return true;
  }
};

/// Inverse of the right Jacobian of SO(3): Log(Exp(phi) Exp(d)) == phi + it * d, to first order. |phi| < pi.
inline Eigen::Matrix3d InverseRightJacobianSo3(const Eigen::Vector3d& phi) {
  const Eigen::Matrix3d skew = Skew(phi);
  const double angle = phi.norm();
  // Below, the closed form divides zero by zero.
  constexpr double kSmallAngle = 1e-4;
  const double second =
      angle < kSmallAngle ? 1.0 / 12 : 1 / (angle * angle) - (1 + std::cos(angle)) / (2 * angle * std::sin(angle));
  return Eigen::Matrix3d::Identity() + 0.5 * skew + second * skew * skew;
}

/// How far two poses are from a measured T_from_to: translation and rotation vector of the difference, each over its
/// sigma.
class RelativePoseCost final : public ceres::SizedCostFunction<6, kPoseSize, kPoseSize> {
 public:
  RelativePoseCost(const Pose3& T_from_to, double sigma_m, double sigma_rad)
      : T_to_from_(T_from_to.Inverse()), sigma_m_(sigma_m), sigma_rad_(sigma_rad) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Pose3 T_from_to = ToPose(parameters[0]).Inverse() * ToPose(parameters[1]);
    const Pose3 difference = T_to_from_ * T_from_to;
    const Eigen::Vector3d turn = LogSo3(difference.rotation());
    Eigen::Map<Eigen::Matrix<double, 6, 1>> residual(residuals);
    residual << difference.translation() / sigma_m_, turn / sigma_rad_;
    if (jacobians == nullptr) return true;
    Eigen::Matrix<double, 6, 6> by_to = Eigen::Matrix<double, 6, 6>::Zero();
    by_to.topLeftCorner<3, 3>() = difference.RotationMatrix() / sigma_m_;
    by_to.bottomRightCorner<3, 3>() = InverseRightJacobianSo3(turn) / sigma_rad_;
    // A step d of `from` moves the difference as the step -Adjoint(T_to_from) d of `to` would.
    if (jacobians[0] != nullptr) Write(-by_to * Adjoint(T_from_to.Inverse()), jacobians[0]);
    if (jacobians[1] != nullptr) Write(by_to, jacobians[1]);
    return true;
  }

 private:
  static void Write(const Eigen::Matrix<double, 6, 6>& by_step, double* jacobian) {
    Eigen::Map<RowMajor<6, kPoseSize>> by_pose(jacobian);
    by_pose.leftCols<6>() = by_step;
    by_pose.rightCols<1>().setZero();
  }

  const Pose3 T_to_from_;
  const double sigma_m_;
  const double sigma_rad_;
};

}  // namespace mapp::internal
