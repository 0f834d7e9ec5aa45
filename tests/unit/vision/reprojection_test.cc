#include "vision/reprojection.h"

#include "tests/unit/vision/synthetic.h"

#include <gtest/gtest.h>

namespace mapp::internal {
namespace {

constexpr double kStep = 1e-6;
/// Central differences of second-order functions with values of some hundred pixels.
constexpr double kRelativeTolerance = 1e-5;

struct Case {
  ReprojectionMeasurement measured;
  Pose3 T_world_camera;
  Eigen::Vector3d p_world;
};

std::vector<Case> RandomCases() {
  Rng rng(21);
  std::vector<Case> cases;
  for (int i = 0; i < 50; ++i) {
    const Pose3 T_world_camera = test::RandomPose(3.0, 5.0, rng);
    const Eigen::Vector3d p_camera = test::RandomVisiblePoint(rng);
    const double depth_m = i % 2 == 0 ? 0.0 : p_camera.z() + 0.1;
    const Eigen::Vector2d pixel = test::kCamera.Project(p_camera) + Eigen::Vector2d(3, -2);
    cases.push_back({{pixel, rng.Uniform(1, 3.5), depth_m, 40.0}, T_world_camera, T_world_camera * p_camera});
  }
  return cases;
}

Eigen::Vector3d ErrorAt(const Case& c, const Pose3& T_world_camera, const Eigen::Vector3d& p_world) {
  return ReprojectionError(test::kCamera, c.measured, T_world_camera.Inverse() * p_world);
}

void ExpectClose(const Eigen::MatrixXd& analytic, const Eigen::MatrixXd& numeric) {
  EXPECT_LT((analytic - numeric).norm(), kRelativeTolerance * (1.0 + numeric.norm())) << "analytic\n"
                                                                                      << analytic << "\nnumeric\n"
                                                                                      << numeric;
}

TEST(ReprojectionTest, IsZeroAtThePerfectMeasurement) {
  const Eigen::Vector3d p_camera(0.3, -0.2, 2.0);
  const ReprojectionMeasurement measured{test::kCamera.Project(p_camera), 1.2, 2.0, 40.0};
  EXPECT_LT(ReprojectionError(test::kCamera, measured, p_camera).norm(), 1e-12);
}

TEST(ReprojectionTest, WeighsDepthAsDisparity) {
  const Eigen::Vector3d p_camera(0.3, -0.2, 2.0);
  const ReprojectionMeasurement measured{test::kCamera.Project(p_camera), 2.0, 2.5, 40.0};
  // 40 / 2.0 - 40 / 2.5 = 4 pixels, sigma 2.
  EXPECT_NEAR(ReprojectionError(test::kCamera, measured, p_camera).z(), 2.0, 1e-12);
}

TEST(ReprojectionTest, DerivativeByPoseIsTheNumericOne) {
  for (const Case& c : RandomCases()) {
    const Eigen::Vector3d p_camera = c.T_world_camera.Inverse() * c.p_world;
    Eigen::Matrix<double, 3, 6> numeric;
    for (int k = 0; k < 6; ++k) {
      const Eigen::Matrix<double, 6, 1> step = kStep * Eigen::Matrix<double, 6, 1>::Unit(k);
      numeric.col(k) = (ErrorAt(c, c.T_world_camera * Pose3::Exp(step), c.p_world) -
                        ErrorAt(c, c.T_world_camera * Pose3::Exp(-step), c.p_world)) /
                       (2 * kStep);
    }
    ExpectClose(ByPose(ReprojectionByPoint(test::kCamera, c.measured, p_camera), p_camera), numeric);
  }
}

TEST(ReprojectionTest, DerivativeByPointIsTheNumericOne) {
  for (const Case& c : RandomCases()) {
    const Pose3 T_camera_world = c.T_world_camera.Inverse();
    Eigen::Matrix3d numeric;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
      numeric.col(k) =
          (ErrorAt(c, c.T_world_camera, c.p_world + step) - ErrorAt(c, c.T_world_camera, c.p_world - step)) /
          (2 * kStep);
    }
    ExpectClose(
        ReprojectionByPoint(test::kCamera, c.measured, T_camera_world * c.p_world) * T_camera_world.RotationMatrix(),
        numeric);
  }
}

}  // namespace
}  // namespace mapp::internal
