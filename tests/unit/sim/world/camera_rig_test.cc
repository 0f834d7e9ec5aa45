#include "sim/world/camera_rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp::sim {
namespace {

TEST(CameraRigTest, KnowsThePapersFiveCameras) {
  EXPECT_THAT(CameraNames(), testing::ElementsAre("d455-1280", "d455-848", "d455-640", "euroc", "city"));
  for (const std::string& name : CameraNames()) {
    const auto rig = MakeRig(name, SensorKind::kRgbd);
    ASSERT_TRUE(rig.ok()) << rig.status();
    EXPECT_EQ(rig->name, name);
    EXPECT_TRUE(rig->camera.Validate().ok()) << name;
    EXPECT_FALSE(rig->right_camera.has_value());
  }
}

TEST(CameraRigTest, GivesTheTablesFigures) {
  const auto large = MakeRig("d455-1280", SensorKind::kMono);
  ASSERT_TRUE(large.ok());
  EXPECT_EQ(large->camera.width_px, 1280);
  EXPECT_EQ(large->camera.height_px, 720);
  EXPECT_THAT(Coefficients(large->camera.projection),
              testing::ElementsAre(634.2, 634.8, 631.8, 359.5, -0.046, 0.032, 0, 0));
  EXPECT_DOUBLE_EQ(large->exposure_s, 80e-6);
  EXPECT_EQ(ModelName(MakeRig("city", SensorKind::kMono)->camera.projection), "pinhole");
}

TEST(CameraRigTest, StereoIsTwoEqualCamerasApart) {
  const auto rig = MakeRig("euroc", SensorKind::kStereo);
  ASSERT_TRUE(rig.ok());
  ASSERT_TRUE(rig->right_camera.has_value());
  EXPECT_EQ(Coefficients(rig->camera.projection), Coefficients(rig->right_camera->projection));
  EXPECT_NEAR(rig->T_left_right.translation().x(), 0.11, 1e-12);
  EXPECT_NEAR(rig->camera.stereo_baseline_m, 0.11, 1e-12);
  EXPECT_TRUE(rig->camera.Validate().ok());
}

TEST(CameraRigTest, NamesTheCamerasWhenAskedForAnother) {
  const Status status = MakeRig("d435", SensorKind::kRgbd).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::AllOf(testing::HasSubstr("d435"), testing::HasSubstr("euroc")));
}

}  // namespace
}  // namespace mapp::sim
