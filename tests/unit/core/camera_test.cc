#include "mapp/base/rng.h"
#include "mapp/camera/camera_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mapp {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

Camera EurocCamera() {
  return {.projection = RadialTangentialCamera{.fx = 458.654,
                                               .fy = 457.296,
                                               .cx = 367.215,
                                               .cy = 248.375,
                                               .k1 = -0.28340811,
                                               .k2 = 0.07395907,
                                               .p1 = 0.00019359,
                                               .p2 = 1.76187114e-05},
          .width_px = 752,
          .height_px = 480,
          .stereo_baseline_m = 0};
}

Camera KinectCamera() {
  return {.projection = PinholeCamera{.fx = 525, .fy = 520, .cx = 320, .cy = 240},
          .width_px = 640,
          .height_px = 480,
          .stereo_baseline_m = 0};
}

TEST(CameraTest, UnprojectIsParallelToWhatWasProjected) {
  Rng rng(4);
  for (const Camera& camera : {EurocCamera(), KinectCamera()}) {
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector2d pixel(rng.Uniform(0, camera.width_px - 1), rng.Uniform(0, camera.height_px - 1));
      const Eigen::Vector3d ray = camera.Unproject(pixel);
      EXPECT_LT((camera.Project(rng.Uniform(0.3, 30) * ray) - pixel).norm(), 1e-6)
          << ModelName(camera.projection) << " at " << pixel.transpose();
    }
  }
}

TEST(CameraTest, UndistortedAgreesAtThePrincipalPoint) {
  const Camera camera = EurocCamera();
  const Eigen::Vector3d ahead(0, 0, 2);
  EXPECT_LT((camera.Project(ahead) - camera.Undistorted().Project(ahead)).norm(), 1e-12);
}

TEST(CameraTest, FieldOfViewIsThePapersEquationTwo) {
  EXPECT_NEAR(KinectCamera().FieldOfView(), 2 * std::atan(320.0 / 525.0), 1e-12);
}

TEST(CameraTest, CoefficientsRoundTripThroughTheirName) {
  for (const Camera& camera : {EurocCamera(), KinectCamera()}) {
    const StatusOr<Projection> made = MakeProjection(ModelName(camera.projection), Coefficients(camera.projection));
    ASSERT_TRUE(made.ok()) << made.status();
    EXPECT_EQ(Coefficients(*made), Coefficients(camera.projection));
  }
  EXPECT_THAT(std::string(MakeProjection("fisheye", {1, 2, 3, 4}).status().message()), StartsWith("camera.model: "));
  EXPECT_THAT(std::string(MakeProjection("pinhole", {1, 2, 3}).status().message()),
              StartsWith("camera.coefficients: "));
}

struct BadCamera {
  const char* name;
  void (*spoil)(Camera&);
  const char* field;
};

class BadCameraTest : public ::testing::TestWithParam<BadCamera> {};

TEST_P(BadCameraTest, IsRefusedNamingTheField) {
  Camera camera = KinectCamera();
  ASSERT_TRUE(camera.Validate().ok());
  GetParam().spoil(camera);
  const Status status = camera.Validate();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), StartsWith(std::string(GetParam().field) + ": "));
}

INSTANTIATE_TEST_SUITE_P(
    Fields, BadCameraTest,
    ::testing::Values(
        BadCamera{"ZeroFocalLength", [](Camera& c) { std::get<PinholeCamera>(c.projection).fx = 0; }, "camera.fx"},
        BadCamera{"NegativeFocalLength", [](Camera& c) { std::get<PinholeCamera>(c.projection).fy = -1; }, "camera.fy"},
        BadCamera{
            "NotANumber",
            [](Camera& c) { std::get<PinholeCamera>(c.projection).cx = std::numeric_limits<double>::quiet_NaN(); },
            "camera.cx"},
        BadCamera{"CenterOutside", [](Camera& c) { std::get<PinholeCamera>(c.projection).cy = 480; }, "camera.cy"},
        BadCamera{"NoWidth", [](Camera& c) { c.width_px = 0; }, "camera.width_px"},
        BadCamera{"HugeHeight", [](Camera& c) { c.height_px = 20000; }, "camera.height_px"},
        BadCamera{"NegativeBaseline", [](Camera& c) { c.stereo_baseline_m = -0.1; }, "camera.stereo_baseline_m"}),
    [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace mapp
