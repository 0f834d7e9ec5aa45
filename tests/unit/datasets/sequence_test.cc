#include "datasets/sequence.h"

#include "datasets/image_file.h"
#include "tests/unit/datasets/temp_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

constexpr char kCameraYaml[] =
    "%YAML:1.0\nresolution: [32, 24]\nintrinsics: [30, 30, 16, 12]\ndepth_scale: 1000\n"
    "distortion_coefficients: [0, 0, 0, 0]\n";

void ExpectError(const Status& status, absl::StatusCode code, const std::string& part) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(part));
}

/// A folder of three small RGB-D frames at 1.0, 1.1 and 1.2 s; frame i is all of gray level 10 i and i + 1 m away.
class TumSequenceTest : public testing::Test {
 protected:
  TumSequenceTest() {
    folder_.Write("camera.yaml", kCameraYaml);
    std::filesystem::create_directories(folder_.path() / "rgb");
    std::filesystem::create_directories(folder_.path() / "depth");
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE(WriteGrayImage(Color(i), GrayImage(32, 24, static_cast<uint8_t>(10 * i))).ok());
      EXPECT_TRUE(WriteDepthImage(folder_.File(fmt::format("depth/{}.png", i)),
                                  DepthImage(32, 24, static_cast<float>(i + 1)), 1000)
                      .ok());
    }
    folder_.Write("rgb.txt", "# t file\n1.0 rgb/0.png\n1.1 rgb/1.png\n1.2 rgb/2.png\n");
    folder_.Write("depth.txt", "# t file\n1.019 depth/0.png\n1.121 depth/1.png\n1.185 depth/2.png\n");
    folder_.Write("groundtruth.txt", "1.0 0 0 0 0 0 0 1\n1.1 0.5 0 0 0 0 0 1\n");
  }
  std::string Color(int i) const { return folder_.File(fmt::format("rgb/{}.png", i)); }
  StatusOr<std::unique_ptr<Sequence>> Open() const { return OpenSequence(folder_.path().string()); }

  test::TempFolder folder_;
};

TEST_F(TumSequenceTest, PairsColorWithTheNearestDepthWithin20Ms) {
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_EQ((*sequence)->sensor(), SensorKind::kRgbd);
  EXPECT_EQ((*sequence)->name(), folder_.path().filename().string());
  ASSERT_EQ((*sequence)->num_frames(), 2);  // the depth of 1.1 s is 21 ms late
  EXPECT_EQ((*sequence)->stamp_ns(1), 1'200'000'000);
  const auto frame = (*sequence)->Read(1);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->stamp_ns, 1'200'000'000);
  EXPECT_EQ(frame->gray.at(31, 23), 20);
  EXPECT_FLOAT_EQ(frame->depth_m.at(31, 23), 3);
  EXPECT_TRUE(frame->right_gray.empty());
  ASSERT_EQ((*sequence)->ground_truth().size(), 2);
  EXPECT_DOUBLE_EQ((*sequence)->ground_truth()[1].T_world_camera.translation().x(), 0.5);
}

TEST_F(TumSequenceTest, WithoutDepthListItIsMonocular) {
  std::filesystem::remove(folder_.path() / "depth.txt");
  std::filesystem::remove(folder_.path() / "groundtruth.txt");
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_EQ((*sequence)->sensor(), SensorKind::kMono);
  EXPECT_EQ((*sequence)->num_frames(), 3);
  EXPECT_TRUE((*sequence)->ground_truth().empty());
  EXPECT_TRUE((*sequence)->Read(0)->depth_m.empty());
}

TEST_F(TumSequenceTest, FrameIndexOutOfRange) {
  ExpectError((*Open())->Read(2).status(), absl::StatusCode::kOutOfRange, "frame 2 of 2");
}

TEST_F(TumSequenceTest, BrokenImageIsDataLossNamingTheFile) {
  folder_.Write("rgb/2.png", "\x89PNG\r\n");
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_TRUE((*sequence)->Read(0).ok());
  ExpectError((*sequence)->Read(1).status(), absl::StatusCode::kDataLoss, Color(2));
}

TEST_F(TumSequenceTest, ImageThatVanishesAfterOpeningIsNotFound) {
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  std::filesystem::remove(Color(0));
  ExpectError((*sequence)->Read(0).status(), absl::StatusCode::kNotFound, Color(0));
}

TEST_F(TumSequenceTest, ImageOfAnotherSizeIsDataLoss) {
  ASSERT_TRUE(WriteGrayImage(Color(0), GrayImage(16, 24)).ok());
  ExpectError((*Open())->Read(0).status(), absl::StatusCode::kDataLoss, "16x24 pixels, the calibration says 32x24");
}

TEST_F(TumSequenceTest, ListedImageThatIsMissing) {
  std::filesystem::remove(Color(1));
  ExpectError(Open().status(), absl::StatusCode::kNotFound, "rgb.txt:3: no such file: " + Color(1));
}

TEST_F(TumSequenceTest, ListWithoutImages) {
  folder_.Write("rgb.txt", "# t file\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, folder_.File("rgb.txt") + ": no images");
}

TEST_F(TumSequenceTest, NoDepthAtAnyTime) {
  folder_.Write("depth.txt", "5.0 depth/0.png\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, folder_.File("depth.txt"));
}

TEST_F(TumSequenceTest, MalformedLine) {
  folder_.Write("rgb.txt", "1.0 rgb/0.png\nsoon rgb/1.png\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, "rgb.txt:2: 'soon' is not a time");
}

TEST_F(TumSequenceTest, TimesThatDoNotIncrease) {
  folder_.Write("rgb.txt", "1.0 rgb/0.png\n1.0 rgb/1.png\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, "rgb.txt:2: times must increase");
}

TEST_F(TumSequenceTest, MalformedGroundTruth) {
  folder_.Write("groundtruth.txt", "1.0 0 0 0 0 0 1\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, "groundtruth.txt:1: 8 fields expected, got 7");
}

TEST_F(TumSequenceTest, ZeroFocalLength) {
  folder_.Write("camera.yaml", "%YAML:1.0\nresolution: [32, 24]\nintrinsics: [0, 30, 16, 12]\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, folder_.File("camera.yaml") + ": intrinsics[0]: ");
}

TEST_F(TumSequenceTest, NoCalibration) {
  std::filesystem::remove(folder_.path() / "camera.yaml");
  ExpectError(Open().status(), absl::StatusCode::kNotFound, folder_.File("camera.yaml"));
}

TEST(OpenSequenceTest, NoFolder) {
  ExpectError(OpenSequence("/nowhere").status(), absl::StatusCode::kNotFound, "/nowhere: no such folder");
}

TEST(OpenSequenceTest, FolderWithoutSequence) {
  const test::TempFolder folder;
  ExpectError(OpenSequence(folder.path().string()).status(), absl::StatusCode::kNotFound, folder.path().string());
}

/// Two stereo frames; the right camera stands 0.1 m to the right of the left one.
class EurocSequenceTest : public testing::Test {
 protected:
  EurocSequenceTest() {
    WriteCamera("cam0", "0");
    WriteCamera("cam1", "0.1");
  }
  void WriteCamera(const std::string& name, const std::string& x_m) const {
    const std::string folder = "mav0/" + name + "/";
    folder_.Write(folder + "sensor.yaml", std::string(kCameraYaml) + "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, " +
                                              x_m + ", 0, 0, 1, 0,\n    0, -1, 0, 0, 0, 0, 0, 1]\n");
    folder_.Write(folder + "data.csv", "#timestamp [ns],filename\n1000000000,1000.png\r\n2000000000,2000.png\r\n");
    std::filesystem::create_directories(folder_.path() / folder / "data");
    const auto level = static_cast<uint8_t>(name == "cam0" ? 50 : 100);
    for (const char* file : {"1000.png", "2000.png"}) {
      EXPECT_TRUE(WriteGrayImage(folder_.File(folder + "data/" + file), GrayImage(32, 24, level)).ok());
    }
  }
  StatusOr<std::unique_ptr<Sequence>> Open() const { return OpenSequence(folder_.path().string() + "/"); }

  test::TempFolder folder_;
};

TEST_F(EurocSequenceTest, TwoCamerasAreStereo) {
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_EQ((*sequence)->name(), folder_.path().filename().string());
  EXPECT_EQ((*sequence)->sensor(), SensorKind::kStereo);
  ASSERT_TRUE((*sequence)->right_camera().has_value());
  EXPECT_NEAR((*sequence)->camera().stereo_baseline_m, 0.1, 1e-12);
  EXPECT_LT(((*sequence)->T_left_right().translation() - Eigen::Vector3d(0.1, 0, 0)).norm(), 1e-12);
  EXPECT_LT(RotationAngle((*sequence)->T_left_right(), Pose3()), 1e-9);
  const auto frame = (*sequence)->Read(1);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->stamp_ns, 2000000000);
  EXPECT_EQ(frame->gray.at(0, 0), 50);
  EXPECT_EQ(frame->right_gray.at(0, 0), 100);
}

TEST_F(EurocSequenceTest, FramesWithoutRightImageAreLeftOut) {
  folder_.Write("mav0/cam1/data.csv", "2000000000,2000.png\n");
  const auto sequence = Open();
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  ASSERT_EQ((*sequence)->num_frames(), 1);
  EXPECT_EQ((*sequence)->stamp_ns(0), 2000000000);
}

TEST_F(EurocSequenceTest, CamerasAtOnePlaceAreNoStereo) {
  WriteCamera("cam1", "0");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, "cam1/sensor.yaml: T_BS");
}

TEST_F(EurocSequenceTest, OneCameraIsMonocular) {
  std::filesystem::remove_all(folder_.path() / "mav0" / "cam1");
  EXPECT_EQ((*Open())->sensor(), SensorKind::kMono);
  folder_.Write("mav0/imu0/data.csv", "#t\n");
  EXPECT_EQ((*Open())->sensor(), SensorKind::kMonoInertial);
}

TEST_F(EurocSequenceTest, MalformedLine) {
  folder_.Write("mav0/cam0/data.csv", "1000000000,1000.png\n20.5,2000.png\n");
  ExpectError(Open().status(), absl::StatusCode::kInvalidArgument, "cam0/data.csv:2: '20.5' is not a time");
}

}  // namespace
}  // namespace mapp
