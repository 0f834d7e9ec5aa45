#include "datasets/calibration.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

constexpr char kEurocYaml[] = R"(%YAML:1.0
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0, 0, 0, 1]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0, 0.00019359, 1.76187114e-05]
)";

/// A valid file in which `key` has another value; an empty value leaves the key out.
std::string YamlWith(const std::string& key, const std::string& value) {
  std::string text = "%YAML:1.0\n";
  const std::vector<std::pair<std::string, std::string>> defaults = {
      {"resolution", "[640, 480]"}, {"intrinsics", "[525, 525, 320, 240]"}, {"depth_scale", "1000"}};
  for (const auto& [name, standard] : defaults) {
    if (name != key) text += name + ": " + standard + "\n";
  }
  if (!value.empty()) text += key + ": " + value + "\n";
  return text;
}

TEST(CalibrationTest, ReadsAnEurocSensorFile) {
  const test::TempFolder folder;
  const auto calibration = ReadCameraCalibration(folder.Write("sensor.yaml", kEurocYaml));
  ASSERT_TRUE(calibration.ok()) << calibration.status();
  EXPECT_EQ(calibration->camera.width_px, 752);
  EXPECT_EQ(calibration->camera.height_px, 480);
  const auto* projection = std::get_if<RadialTangentialCamera>(&calibration->camera.projection);
  ASSERT_NE(projection, nullptr);
  EXPECT_DOUBLE_EQ(projection->fy, 457);
  EXPECT_DOUBLE_EQ(projection->cy, 248.375);
  EXPECT_DOUBLE_EQ(projection->k1, -0.28340811);
  EXPECT_DOUBLE_EQ(projection->p2, 1.76187114e-05);
  const Eigen::Vector3d p_body = calibration->T_body_camera * Eigen::Vector3d(1, 2, 3);
  EXPECT_LT((p_body - Eigen::Vector3d(-2.02, 0.94, 3.01)).norm(), 1e-12);
}

TEST(CalibrationTest, WithoutDistortionTheCameraIsAPinhole) {
  const test::TempFolder folder;
  const auto calibration = ReadCameraCalibration(folder.Write("c.yaml", YamlWith("depth_scale", "1000")));
  ASSERT_TRUE(calibration.ok()) << calibration.status();
  EXPECT_TRUE(std::holds_alternative<PinholeCamera>(calibration->camera.projection));
  EXPECT_DOUBLE_EQ(calibration->depth_units_per_metre, 1000);
}

TEST(CalibrationTest, WithoutDepthScaleTheUnitIsThatOfTheTumDataSet) {
  const test::TempFolder folder;
  const auto calibration = ReadCameraCalibration(folder.Write("c.yaml", YamlWith("depth_scale", "")));
  ASSERT_TRUE(calibration.ok()) << calibration.status();
  EXPECT_DOUBLE_EQ(calibration->depth_units_per_metre, 5000);
}

TEST(CalibrationTest, WrittenFilesReadBack) {
  const test::TempFolder folder;
  const std::string file = folder.File("camera.yaml");
  for (const Projection& projection :
       {Projection(PinholeCamera{525.25, 524.5, 319.5, 239.5}),
        Projection(RadialTangentialCamera{500, 501, 320, 240, -0.3, 0.1, 1e-4, -2e-5})}) {
    const Camera camera{projection, 640, 480};
    const Pose3 T_body_camera(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), {0.1, -0.2, 0.3});
    ASSERT_TRUE(WriteCameraCalibration(file, {camera, T_body_camera, 5000}, 15).ok());
    const auto read = ReadCameraCalibration(file);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(ModelName(read->camera.projection), ModelName(projection));
    EXPECT_EQ(Coefficients(read->camera.projection), Coefficients(projection));
    EXPECT_EQ(read->camera.width_px, 640);
    EXPECT_LT((read->T_body_camera.Matrix() - T_body_camera.Matrix()).norm(), 1e-12);
    EXPECT_DOUBLE_EQ(read->depth_units_per_metre, 5000);
  }
}

struct BadYaml {
  std::string name;
  std::string key;
  std::string value;
  std::string problem;
};

class BadCalibrationTest : public testing::TestWithParam<BadYaml> {};

TEST_P(BadCalibrationTest, NamesFileAndField) {
  const test::TempFolder folder;
  const std::string file = folder.Write("camera.yaml", YamlWith(GetParam().key, GetParam().value));
  const Status status = ReadCameraCalibration(file).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(file + ": "));
  EXPECT_THAT(std::string(status.message()), HasSubstr(GetParam().problem));
}

INSTANTIATE_TEST_SUITE_P(
    Keys, BadCalibrationTest,
    testing::Values(BadYaml{"ZeroFocalLength", "intrinsics", "[0, 525, 320, 240]", "intrinsics[0]: "},
                    BadYaml{"NegativeFocalLength", "intrinsics", "[525, -1.5, 320, 240]", "intrinsics[1]: "},
                    BadYaml{"NotFinite", "intrinsics", "[525, 525, .nan, 240]", "intrinsics[2]: "},
                    BadYaml{"Word", "intrinsics", "[525, five, 320, 240]", "intrinsics[1]: "},
                    BadYaml{"TooFew", "intrinsics", "[525, 525, 320]", "intrinsics: a list of 4"},
                    BadYaml{"NoIntrinsics", "intrinsics", "", "intrinsics: a list of 4"},
                    BadYaml{"CenterOutside", "intrinsics", "[525, 525, 3200, 240]", "cx"},
                    BadYaml{"NoResolution", "resolution", "", "resolution: a list of 2"},
                    BadYaml{"NegativeResolution", "resolution", "[-640, 480]", "resolution[0]: "},
                    BadYaml{"HugeResolution", "resolution", "[640, 48000000000]", "resolution[1]: "},
                    BadYaml{"ZeroDepthScale", "depth_scale", "0", "depth_scale: must be positive"},
                    BadYaml{"WordDepthScale", "depth_scale", "many", "depth_scale: a number"},
                    BadYaml{"Imu", "sensor_type", "imu", "sensor_type: 'camera' expected, got 'imu'"},
                    BadYaml{"Fisheye", "distortion_model", "equidistant", "distortion_model: "},
                    BadYaml{"NoPose", "T_BS", "7", "T_BS: "},
                    BadYaml{"NoRotation", "T_BS", "{ data: [2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1] }", "T_BS.data: "},
                    BadYaml{"Mirror", "T_BS", "{ data: [-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1] }", "T_BS.data: "}),
    [](const auto& suite) { return suite.param.name; });

TEST(CalibrationTest, NamesTheLineThatDoesNotParse) {
  const test::TempFolder folder;
  const std::string file = folder.Write("camera.yaml", "%YAML:1.0\nresolution: [640, 480]\njunk\n");
  const Status status = ReadCameraCalibration(file).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr(file + "("));
}

TEST(CalibrationTest, RejectsFilesThatAreNoYaml) {
  const test::TempFolder folder;
  for (const std::string& text : {std::string(), std::string("fx: 525\n"), std::string("\x01\x02\xff\0\x7f", 5)}) {
    const std::string file = folder.Write("camera.yaml", text);
    const Status status = ReadCameraCalibration(file).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr(file));
  }
}

TEST(CalibrationTest, ReportsAMissingFile) {
  const Status status = ReadCameraCalibration("/nowhere/camera.yaml").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/nowhere/camera.yaml"));
}

}  // namespace
}  // namespace mapp
