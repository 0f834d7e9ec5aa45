#include "api/convert/convert.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

namespace mapp {
namespace {

using testing::StartsWith;

std::string MessageOf(const Status& status) { return {status.message().data(), status.message().size()}; }

Camera RadialCamera() {
  Camera camera;
  camera.projection =
      RadialTangentialCamera{.fx = 458.6, .fy = 457.3, .cx = 367.2, .cy = 248.4, .k1 = -0.28, .k2 = 0.07, .p1 = 2e-4};
  camera.width_px = 752;
  camera.height_px = 480;
  camera.stereo_baseline_m = 0.11;
  return camera;
}

TEST(ConvertTest, PoseRoundTrip) {
  const Pose3 pose(Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5), {1.25, -2.5, 1e5});
  const StatusOr<Pose3> back = FromProto(ToProto(pose), "pose");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->translation(), pose.translation());
  EXPECT_LT(RotationAngle(*back, pose), 1e-12);
}

TEST(ConvertTest, QuaternionsFromFloatsAreAccepted) {
  v1::Pose pose = ToProto(Pose3());
  pose.set_qw(1.0005);
  const StatusOr<Pose3> back = FromProto(pose, "pose");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_DOUBLE_EQ(back->rotation().norm(), 1);
}

struct BadPose {
  std::string name;
  std::function<void(v1::Pose&)> spoil;
};
class BadPoseTest : public testing::TestWithParam<BadPose> {};

TEST_P(BadPoseTest, IsRefusedByPath) {
  v1::Pose pose = ToProto(Pose3());
  GetParam().spoil(pose);
  const Status status = FromProto(pose, "aligned.pose_map_session").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(MessageOf(status), StartsWith("aligned.pose_map_session: "));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadPoseTest,
    testing::Values(BadPose{"NaN", [](v1::Pose& p) { p.set_tx_m(std::nan("")); }},
                    BadPose{"Infinite", [](v1::Pose& p) { p.set_tz_m(std::numeric_limits<double>::infinity()); }},
                    BadPose{"BeyondTheLimit", [](v1::Pose& p) { p.set_ty_m(-1.1e6); }},
                    BadPose{"LongQuaternion", [](v1::Pose& p) { p.set_qw(1.01); }},
                    BadPose{"ZeroQuaternion", [](v1::Pose& p) { p.set_qw(0); }},
                    BadPose{"NaNQuaternion", [](v1::Pose& p) { p.set_qy(std::nan("")); }}),
    [](const auto& param_info) { return param_info.param.name; });

TEST(ConvertTest, CameraRoundTrip) {
  const Camera camera = RadialCamera();
  const StatusOr<Camera> back = FromProto(ToProto(camera), "camera");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(ModelName(back->projection), "radial-tangential");
  EXPECT_EQ(Coefficients(back->projection), Coefficients(camera.projection));
  EXPECT_EQ(back->width_px, camera.width_px);
  EXPECT_EQ(back->height_px, camera.height_px);
  EXPECT_EQ(back->stereo_baseline_m, camera.stereo_baseline_m);
}

struct BadCamera {
  std::string name;
  std::string field;
  std::function<void(v1::Camera&)> spoil;
};
class BadCameraTest : public testing::TestWithParam<BadCamera> {};

TEST_P(BadCameraTest, IsRefusedByPath) {
  v1::Camera camera = ToProto(RadialCamera());
  GetParam().spoil(camera);
  const Status status = FromProto(camera, "cameras[1]").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(MessageOf(status), StartsWith("cameras[1]." + GetParam().field + ": "));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadCameraTest,
    testing::Values(
        BadCamera{"ZeroFocalLength", "fx", [](v1::Camera& c) { c.set_coefficients(0, 0); }},
        BadCamera{"NaNFocalLength", "fy", [](v1::Camera& c) { c.set_coefficients(1, std::nan("")); }},
        BadCamera{"UnknownModel", "model", [](v1::Camera& c) { c.set_model("fisheye"); }},
        BadCamera{"TooFewCoefficients", "coefficients", [](v1::Camera& c) { c.mutable_coefficients()->RemoveLast(); }},
        BadCamera{"NoWidth", "width_px", [](v1::Camera& c) { c.set_width_px(0); }},
        BadCamera{"WidthBeyondInt", "width_px", [](v1::Camera& c) { c.set_width_px(0xffffffffU); }},
        BadCamera{"HugeDistortion", "k1", [](v1::Camera& c) { c.set_coefficients(4, 1e9); }},
        BadCamera{"NegativeBaseline", "stereo_baseline_m", [](v1::Camera& c) { c.set_stereo_baseline_m(-0.1); }}),
    [](const auto& param_info) { return param_info.param.name; });

TEST(ConvertTest, FeatureSettingsRoundTrip) {
  const FeatureSettings settings{
      .descriptor_kind = "BEBLID-256", .scale_factor = 1.5F, .num_levels = 4, .patch_size_px = 41};
  const StatusOr<FeatureSettings> back = FromProto(ToProto(settings), "feature_settings");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->descriptor_kind, settings.descriptor_kind);
  EXPECT_EQ(back->scale_factor, settings.scale_factor);
  EXPECT_EQ(back->num_levels, settings.num_levels);
  EXPECT_EQ(back->patch_size_px, settings.patch_size_px);
}

struct BadFeatures {
  std::string name;
  std::string field;
  std::function<void(v1::FeatureSettings&)> spoil;
};
class BadFeaturesTest : public testing::TestWithParam<BadFeatures> {};

TEST_P(BadFeaturesTest, AreRefusedByPath) {
  v1::FeatureSettings settings = ToProto(FeatureSettings());
  GetParam().spoil(settings);
  const Status status = FromProto(settings, "sessions[2].features").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(MessageOf(status), StartsWith("sessions[2].features." + GetParam().field + ": "));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadFeaturesTest,
    testing::Values(BadFeatures{"NoDescriptor", "descriptor_kind", [](auto& s) { s.clear_descriptor_kind(); }},
                    BadFeatures{"NoScale", "scale_factor", [](auto& s) { s.clear_scale_factor(); }},
                    BadFeatures{"NaNScale", "scale_factor", [](auto& s) { s.set_scale_factor(std::nanf("")); }},
                    BadFeatures{"NoLevels", "num_levels", [](auto& s) { s.clear_num_levels(); }},
                    BadFeatures{"LevelsBeyondInt", "num_levels", [](auto& s) { s.set_num_levels(0xffffffffU); }},
                    BadFeatures{"NoPatch", "patch_size_px", [](auto& s) { s.clear_patch_size_px(); }}),
    [](const auto& param_info) { return param_info.param.name; });

TEST(ConvertTest, SensorKindsRoundTrip) {
  for (const SensorKind kind : {SensorKind::kMono, SensorKind::kMonoInertial, SensorKind::kStereo, SensorKind::kRgbd}) {
    const StatusOr<SensorKind> back = FromProto(ToProto(kind), "sensor");
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_EQ(*back, kind);
  }
}

TEST(ConvertTest, UnknownSensorKindsAreRefused) {
  for (const int kind : {0, 17, -1}) {
    const Status status = FromProto(static_cast<v1::SensorKind>(kind), "sensor").status();
    EXPECT_THAT(MessageOf(status), StartsWith("sensor: "));
  }
}

TEST(ConvertTest, TileKeysRoundTripAndStrayBitsAreRefused) {
  const TileKey key{.x = -3, .y = 0, .z = 1'000'000};
  const StatusOr<TileKey> back = TileKeyFromProto(key.Packed(), "held_tiles[0].key");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(*back, key);
  const Status status = TileKeyFromProto(key.Packed() | uint64_t{1} << 63, "held_tiles[0].key").status();
  EXPECT_THAT(MessageOf(status), StartsWith("held_tiles[0].key: "));
}

TEST(ConvertTest, SessionIdZeroIsNoSession) {
  EXPECT_FALSE(SessionIdFromProto(0, "session_id").ok());
  EXPECT_EQ(SessionIdFromProto(0xffffffffU, "session_id").value(), SessionId(0xffffffffU));
}

TEST(ConvertTest, RangesRefuseNaN) {
  EXPECT_TRUE(ValidateRange(1, 0, 1, "overlap").ok());
  EXPECT_FALSE(ValidateRange(1.001, 0, 1, "overlap").ok());
  EXPECT_FALSE(ValidateRange(std::nan(""), 0, 1, "overlap").ok());
}

}  // namespace
}  // namespace mapp
