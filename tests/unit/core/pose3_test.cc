#include "mapp/geometry/pose3.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

/// Rounding of a few dozen double operations on coordinates of some metres.
constexpr double kTolerance = 1e-9;

Eigen::Matrix<double, 6, 1> RandomTangent(Rng& rng, double angle) {
  Eigen::Vector3d axis(rng.Normal(), rng.Normal(), rng.Normal());
  Eigen::Matrix<double, 6, 1> tangent;
  tangent << rng.Normal(), rng.Normal(), rng.Normal(), angle * axis.normalized();
  return tangent;
}

TEST(Pose3Test, LogInvertsExpAtAllAngles) {
  Rng rng(1);
  for (const double angle : {0.0, 1e-9, 1e-6, 1e-4, 0.1, 1.0, 3.0, std::numbers::pi - 1e-4}) {
    for (int i = 0; i < 20; ++i) {
      const Eigen::Matrix<double, 6, 1> tangent = RandomTangent(rng, angle);
      const Eigen::Matrix<double, 6, 1> back = Pose3::Exp(tangent).Log();
      EXPECT_LT((back - tangent).norm(), 1e-7) << "angle " << angle << "\n" << tangent << "\n" << back;
    }
  }
}

TEST(Pose3Test, StoredPosesKeepTheirBits) {
  Rng rng(7);
  for (int i = 0; i < 1000; ++i) {
    const Pose3 pose = Pose3::Exp(RandomTangent(rng, rng.Uniform(0, 3)));
    const Pose3 again = Pose3::FromStored(pose.rotation(), pose.translation());
    EXPECT_EQ(again.rotation().coeffs(), pose.rotation().coeffs());
    EXPECT_EQ(again.translation(), pose.translation());
  }
  const Eigen::Quaterniond twice_as_long(2, 0, 0, 0);
  EXPECT_EQ(Pose3::FromStored(twice_as_long, Eigen::Vector3d::Zero()).rotation().w(), 1);
}

TEST(Pose3Test, InverseAndCompositionAgreeWithMatrices) {
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    const Pose3 T_a_b = Pose3::Exp(RandomTangent(rng, rng.Uniform(0, 3)));
    const Pose3 T_b_c = Pose3::Exp(RandomTangent(rng, rng.Uniform(0, 3)));
    const Eigen::Vector3d p_c(rng.Normal(), rng.Normal(), rng.Normal());
    EXPECT_LT(((T_a_b * T_b_c).Matrix() - T_a_b.Matrix() * T_b_c.Matrix()).norm(), kTolerance);
    EXPECT_LT(((T_a_b * T_b_c) * p_c - T_a_b * (T_b_c * p_c)).norm(), kTolerance);
    EXPECT_LT(((T_a_b.Inverse() * T_a_b).Matrix() - Eigen::Matrix4d::Identity()).norm(), kTolerance);
  }
}

TEST(Pose3Test, RotationAngleIsSymmetricAndSignFree) {
  const Pose3 a;
  const Pose3 b(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY())), Eigen::Vector3d::Zero());
  const Pose3 minus_b(Eigen::Quaterniond(-b.rotation().coeffs()), Eigen::Vector3d::Zero());
  EXPECT_NEAR(RotationAngle(a, b), 0.5, kTolerance);
  EXPECT_NEAR(RotationAngle(b, a), 0.5, kTolerance);
  EXPECT_NEAR(RotationAngle(a, minus_b), 0.5, kTolerance);
}

TEST(AlignPointsTest, RecoversSimilarityAndRigidMotion) {
  Rng rng(3);
  for (const bool with_scale : {false, true}) {
    const Sim3 truth{with_scale ? 2.5 : 1.0, Pose3::Exp(RandomTangent(rng, 1.2))};
    Eigen::Matrix3Xd source(3, 20);
    Eigen::Matrix3Xd target(3, 20);
    for (int i = 0; i < source.cols(); ++i) {
      source.col(i) = Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
      target.col(i) = truth * Eigen::Vector3d(source.col(i));
    }
    const Sim3 found = AlignPoints(source, target, with_scale);
    EXPECT_NEAR(found.scale, truth.scale, kTolerance);
    EXPECT_LT((found.pose.Matrix() - truth.pose.Matrix()).norm(), 1e-8);
  }
}

TEST(Sim3Test, InvertsAndMovesCameras) {
  Rng rng(4);
  const Sim3 S_a_b{2.5, Pose3::Exp(RandomTangent(rng, 1.2))};
  const Eigen::Vector3d p_b(1, -2, 3);
  EXPECT_LT((S_a_b.Inverse() * (S_a_b * p_b) - p_b).norm(), kTolerance);
  const Pose3 T_b_camera = Pose3::Exp(RandomTangent(rng, 1.2));
  const Pose3 T_a_camera = S_a_b * T_b_camera;
  // A camera sees the same way wherever it is told from: its points, their depths in the other unit, are the same ones.
  const Eigen::Vector3d p_camera(0.3, 0.2, 2);
  EXPECT_LT((T_a_camera * (S_a_b.scale * p_camera) - S_a_b * (T_b_camera * p_camera)).norm(), kTolerance);
  EXPECT_LT(((S_a_b.Inverse() * T_a_camera).Matrix() - T_b_camera.Matrix()).norm(), 1e-8);
}

TEST(AlignPointsTest, NeverMirrors) {
  // A flat cloud has two fits of equal error, one of them a reflection.
  Eigen::Matrix3Xd source(3, 4);
  source << 1, -1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0;
  Eigen::Matrix3Xd target = source;
  target.row(0) *= -1;
  const Sim3 found = AlignPoints(source, target, false);
  EXPECT_NEAR(found.pose.RotationMatrix().determinant(), 1.0, kTolerance);
}

}  // namespace
}  // namespace mapp
