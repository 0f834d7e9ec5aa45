#include "mapp/geometry/pose3.h"

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// Below this angle the closed forms lose digits and their series are exact to double precision.
constexpr double kSmallAngle = 1e-5;
/// Of a squared norm from 1: far more than rounding leaves of a unit quaternion.
constexpr double kUnitTolerance = 1e-9;

/// Left Jacobian of SO(3): translation of Exp([rho; phi]) is V(phi) * rho (Sola et al. 2018, equation 145).
Eigen::Matrix3d LeftJacobianSo3(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const Eigen::Matrix3d skew = Skew(phi);
  if (angle < kSmallAngle) return Eigen::Matrix3d::Identity() + 0.5 * skew + skew * skew / 6.0;
  const double a2 = angle * angle;
  return Eigen::Matrix3d::Identity() + (1 - std::cos(angle)) / a2 * skew +
         (angle - std::sin(angle)) / (a2 * angle) * skew * skew;
}

Eigen::Matrix3d LeftJacobianInverseSo3(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const Eigen::Matrix3d skew = Skew(phi);
  if (angle < kSmallAngle) return Eigen::Matrix3d::Identity() - 0.5 * skew + skew * skew / 12.0;
  const double half = 0.5 * angle;
  const double factor = (1 - half / std::tan(half)) / (angle * angle);
  return Eigen::Matrix3d::Identity() - 0.5 * skew + factor * skew * skew;
}

}  // namespace

Pose3 Pose3::FromStored(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  Pose3 pose(rotation, translation);
  if (std::abs(rotation.squaredNorm() - 1) < kUnitTolerance) pose.rotation_ = rotation;
  return pose;
}

Pose3 Pose3::FromMatrix(const Eigen::Matrix4d& matrix) {
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const Eigen::Vector3d translation = matrix.topRightCorner<3, 1>();
  return Pose3(Eigen::Quaterniond(rotation), translation);
}

Eigen::Matrix4d Pose3::Matrix() const {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = RotationMatrix();
  matrix.topRightCorner<3, 1>() = translation_;
  return matrix;
}

Pose3 Pose3::Exp(const Eigen::Matrix<double, 6, 1>& tangent) {
  const Eigen::Vector3d phi = tangent.tail<3>();
  const Eigen::Vector3d translation = LeftJacobianSo3(phi) * tangent.head<3>();
  return Pose3(ExpSo3(phi), translation);
}

Eigen::Matrix<double, 6, 1> Pose3::Log() const {
  Eigen::Matrix<double, 6, 1> tangent;
  const Eigen::Vector3d phi = LogSo3(rotation_);
  tangent.head<3>() = LeftJacobianInverseSo3(phi) * translation_;
  tangent.tail<3>() = phi;
  return tangent;
}

double RotationAngle(const Pose3& a, const Pose3& b) { return LogSo3(a.rotation().conjugate() * b.rotation()).norm(); }

double Distance(const Pose3& a, const Pose3& b) { return (a.translation() - b.translation()).norm(); }

Eigen::Matrix<double, 6, 6> Adjoint(const Pose3& T) {
  const Eigen::Matrix3d R = T.RotationMatrix();
  Eigen::Matrix<double, 6, 6> adjoint = Eigen::Matrix<double, 6, 6>::Zero();
  adjoint.topLeftCorner<3, 3>() = R;
  adjoint.topRightCorner<3, 3>() = Skew(T.translation()) * R;
  adjoint.bottomRightCorner<3, 3>() = R;
  return adjoint;
}

Eigen::Matrix3d Skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d skew;
  skew << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return skew;
}

Eigen::Quaterniond ExpSo3(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const double half = 0.5 * angle;
  const double scale = angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  const Eigen::Vector3d axis = scale * phi;
  return Eigen::Quaterniond(std::cos(half), axis.x(), axis.y(), axis.z()).normalized();
}

Eigen::Vector3d LogSo3(const Eigen::Quaterniond& rotation) {
  // Of q and -q, the one with w >= 0 gives the angle in [0, pi].
  const double sign = rotation.w() < 0 ? -1.0 : 1.0;
  const Eigen::Vector3d axis = sign * rotation.vec();
  const double w = sign * rotation.w();
  const double sine = axis.norm();
  if (sine < kSmallAngle) return 2.0 / w * (1.0 - sine * sine / (3.0 * w * w)) * axis;
  return 2.0 * std::atan2(sine, w) / sine * axis;
}

Sim3 AlignPoints(const Eigen::Matrix3Xd& source, const Eigen::Matrix3Xd& target, bool with_scale) {
  const Eigen::Vector3d source_mean = source.rowwise().mean();
  const Eigen::Vector3d target_mean = target.rowwise().mean();
  const Eigen::Matrix3Xd source_centered = source.colwise() - source_mean;
  const Eigen::Matrix3Xd target_centered = target.colwise() - target_mean;
  const double n = static_cast<double>(source.cols());
  const Eigen::Matrix3d covariance = target_centered * source_centered.transpose() / n;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;
  const Eigen::Matrix3d rotation = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  double scale = 1.0;
  if (with_scale) {
    const double variance = source_centered.squaredNorm() / n;
    if (variance > 0) scale = svd.singularValues().dot(sign) / variance;
  }
  const Eigen::Vector3d translation = target_mean - scale * (rotation * source_mean);
  return {scale, Pose3(Eigen::Quaterniond(rotation), translation)};
}

}  // namespace mapp
