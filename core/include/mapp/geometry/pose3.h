#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace mapp {

/// SE(3). `T_a_b` maps points of frame b to frame a: p_a = T_a_b * p_b. Perturbation is on the right,
/// T [+] d = T * Exp(d), d = [rho; phi] (metres; radians).
class Pose3 {
 public:
  Pose3() = default;
  Pose3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation) {}
  /// With the quaternion's very bits, which the constructor may round anew: what is stored and read again is the same.
  /// `rotation` is of unit length up to rounding, or is normalised.
  static Pose3 FromStored(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation);
  static Pose3 FromMatrix(const Eigen::Matrix4d& matrix);

  const Eigen::Quaterniond& rotation() const { return rotation_; }
  const Eigen::Vector3d& translation() const { return translation_; }
  Eigen::Matrix3d RotationMatrix() const { return rotation_.toRotationMatrix(); }
  Eigen::Matrix4d Matrix() const;

  Pose3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation_.conjugate();
    return Pose3(inverse, -(inverse * translation_));
  }
  Pose3 operator*(const Pose3& other) const {
    return Pose3(rotation_ * other.rotation_, translation_ + rotation_ * other.translation_);
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return rotation_ * point + translation_; }

  static Pose3 Exp(const Eigen::Matrix<double, 6, 1>& tangent);
  Eigen::Matrix<double, 6, 1> Log() const;
  bool IsFinite() const { return rotation_.coeffs().allFinite() && translation_.allFinite(); }

 private:
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation_ = Eigen::Vector3d::Zero();
};

/// Angle of the rotation that takes a to b, radians in [0, pi].
double RotationAngle(const Pose3& a, const Pose3& b);
/// Distance between the origins, metres.
double Distance(const Pose3& a, const Pose3& b);
/// Cross-product matrix: Skew(a) * b == a x b.
Eigen::Matrix3d Skew(const Eigen::Vector3d& v);
/// For perturbations [rho; phi]: T * Exp(d) == Exp(Adjoint(T) * d) * T.
Eigen::Matrix<double, 6, 6> Adjoint(const Pose3& T);
/// Rotation vector to rotation, and back.
Eigen::Quaterniond ExpSo3(const Eigen::Vector3d& phi);
Eigen::Vector3d LogSo3(const Eigen::Quaterniond& rotation);

/// Similarity: p_a = scale * R * p_b + t. For sessions without metric scale.
struct Sim3 {
  double scale = 1.0;
  Pose3 pose;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (pose.rotation() * point) + pose.translation();
  }
  /// T_a_c of a body that stands at `T_b_c`: turned, and moved in the units of a. Lengths within c are not scaled.
  Pose3 operator*(const Pose3& T_b_c) const {
    return Pose3(pose.rotation() * T_b_c.rotation(), *this * T_b_c.translation());
  }
  Sim3 Inverse() const {
    const Eigen::Quaterniond inverse = pose.rotation().conjugate();
    return {1 / scale, Pose3(inverse, -(inverse * pose.translation()) / scale)};
  }
};

/// Least-squares similarity (Umeyama 1991) with target ~ S * source. Both 3 x N, N >= 3.
/// With `with_scale` false the scale is 1 and the result is the best rigid motion.
Sim3 AlignPoints(const Eigen::Matrix3Xd& source, const Eigen::Matrix3Xd& target, bool with_scale);

/// Axis-aligned box, metres; empty until something is added.
using Aabb = Eigen::AlignedBox3d;

}  // namespace mapp
