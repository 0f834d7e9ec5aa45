#include "sim/sequence_writer.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace mapp::sim {
namespace {

using test::TempFolder;

/// Three frames of smooth shades, of any kind of sensor.
class ShadedSequence final : public Sequence {
 public:
  explicit ShadedSequence(SensorKind sensor) : sensor_(sensor) {
    camera_.projection = RadialTangentialCamera{60, 61, 31.5, 23.5, -0.1, 0.02, 0, 0};
    camera_.width_px = 64;
    camera_.height_px = 48;
    if (sensor == SensorKind::kStereo) {
      camera_.stereo_baseline_m = 0.11;
      right_camera_ = camera_;
      T_left_right_ = Pose3(Eigen::Quaterniond::Identity(), {0.11, 0, 0});
    }
    for (int i = 0; i < 3; ++i) {
      poses_.push_back(
          {3'600'000'000'000 + int64_t{i} * 50'000'001, Pose3(Eigen::Quaterniond(1, 0.1 * i, 0, 0), {0.5 * i, 1, 2})});
    }
  }

  const std::string& name() const override { return name_; }
  SensorKind sensor() const override { return sensor_; }
  const Camera& camera() const override { return camera_; }
  const std::optional<Camera>& right_camera() const override { return right_camera_; }
  const Pose3& T_left_right() const override { return T_left_right_; }
  size_t num_frames() const override { return poses_.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return poses_.at(frame_idx).stamp_ns; }
  const std::vector<StampedPose>& ground_truth() const override { return poses_; }

  StatusOr<SequenceFrame> Read(size_t frame_idx) const override {
    SequenceFrame frame;
    frame.stamp_ns = poses_.at(frame_idx).stamp_ns;
    frame.gray = Shades(static_cast<int>(frame_idx));
    if (sensor_ == SensorKind::kRgbd) frame.depth_m = DepthImage(64, 48, 1.5F + 0.25F * static_cast<float>(frame_idx));
    if (right_camera_) frame.right_gray = Shades(static_cast<int>(frame_idx) + 40);
    return frame;
  }

 private:
  static GrayImage Shades(int offset) {
    GrayImage image(64, 48);
    for (int y = 0; y < 48; ++y) {
      for (int x = 0; x < 64; ++x) image.at(x, y) = static_cast<uint8_t>(2 * x + y + offset);
    }
    return image;
  }

  const std::string name_ = "shades";
  const SensorKind sensor_;
  Camera camera_;
  std::optional<Camera> right_camera_;
  Pose3 T_left_right_;
  std::vector<StampedPose> poses_;
};

const Pose3 kBodyCamera(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), {0.01, 0.02, 0.03});

std::vector<ImuSample> Readings() {
  std::vector<ImuSample> samples;
  for (int i = 0; i < 30; ++i) samples.push_back({int64_t{i} * 5'000'000, {0.1 * i, 0, -1}, {0, 9.81, 1e-9 * i}});
  return samples;
}

void ExpectNear(const GrayImage& a, const GrayImage& b) {
  ASSERT_EQ(a.pixels.size(), b.pixels.size());
  for (size_t i = 0; i < a.pixels.size(); ++i) ASSERT_LE(std::abs(int{a.pixels[i]} - int{b.pixels[i]}), 4);
}

class RoundTripTest : public testing::TestWithParam<SensorKind> {};

TEST_P(RoundTripTest, AWrittenSequenceReadsBackAsItWas) {
  const TempFolder folder;
  const ShadedSequence sequence(GetParam());
  const std::vector<ImuSample> imu = Readings();
  SequenceWriterOptions options;
  options.rate_hz = 20;
  options.T_body_camera = kBodyCamera;
  if (GetParam() == SensorKind::kMonoInertial || GetParam() == SensorKind::kStereo) options.imu = imu;
  const Status written = WriteSequence(sequence, folder.File("visit"), options);
  ASSERT_TRUE(written.ok()) << written;

  const auto opened = OpenSequence(folder.File("visit"));
  ASSERT_TRUE(opened.ok()) << opened.status();
  const Sequence& read = **opened;
  EXPECT_EQ(read.sensor(), GetParam());
  EXPECT_EQ(Coefficients(read.camera().projection), Coefficients(sequence.camera().projection));
  EXPECT_EQ(read.right_camera().has_value(), sequence.right_camera().has_value());
  EXPECT_LT(Distance(read.T_left_right(), sequence.T_left_right()), 1e-12);
  ASSERT_EQ(read.num_frames(), sequence.num_frames());
  ASSERT_EQ(read.ground_truth().size(), sequence.num_frames());
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    const SequenceFrame before = sequence.Read(i).value();
    const auto after = read.Read(i);
    ASSERT_TRUE(after.ok()) << after.status();
    EXPECT_EQ(after->stamp_ns, before.stamp_ns);
    ExpectNear(after->gray, before.gray);
    ExpectNear(after->right_gray, before.right_gray);
    ASSERT_EQ(after->depth_m.pixels.size(), before.depth_m.pixels.size());
    if (!before.depth_m.empty()) {
      EXPECT_NEAR(after->depth_m.at(5, 6), before.depth_m.at(5, 6), 1e-4);
    }
    EXPECT_LT(Distance(read.ground_truth()[i].T_world_camera, sequence.ground_truth()[i].T_world_camera), 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(Sensors, RoundTripTest,
                         testing::Values(SensorKind::kRgbd, SensorKind::kStereo, SensorKind::kMono,
                                         SensorKind::kMonoInertial));

TEST(SequenceWriterTest, ImuGoesIntoEurocsTable) {
  const TempFolder folder;
  const std::vector<ImuSample> imu = Readings();
  SequenceWriterOptions options;
  options.imu = imu;
  ASSERT_TRUE(WriteSequence(ShadedSequence(SensorKind::kMonoInertial), folder.File("visit"), options).ok());
  std::ifstream stream(folder.path() / "visit/mav0/imu0/data.csv");
  std::string line;
  std::getline(stream, line);
  EXPECT_EQ(line.front(), '#');
  for (const ImuSample& sample : imu) {
    ASSERT_TRUE(std::getline(stream, line));
    std::istringstream fields(line);
    int64_t stamp_ns = 0;
    double values[6] = {};
    char comma = 0;
    fields >> stamp_ns;
    for (double& value : values) fields >> comma >> value;
    ASSERT_FALSE(fields.fail()) << line;
    EXPECT_EQ(stamp_ns, sample.stamp_ns);
    EXPECT_NEAR(values[0], sample.angular_velocity_body.x(), 1e-7);
    EXPECT_NEAR(values[4], sample.acceleration_body.y(), 1e-7);
  }
  EXPECT_FALSE(std::getline(stream, line));
}

TEST(SequenceWriterTest, WritesColorWhereItIsGiven) {
  const TempFolder folder;
  const ShadedSequence sequence(SensorKind::kRgbd);
  SequenceWriterOptions options;
  options.read_colored = [&](size_t frame_idx) -> StatusOr<ColoredFrame> {
    return ColoredFrame{sequence.Read(frame_idx).value(), Image<std::array<uint8_t, 3>>(64, 48, {255, 0, 0})};
  };
  ASSERT_TRUE(WriteSequence(sequence, folder.File("visit"), options).ok());
  const auto frame = OpenSequence(folder.File("visit")).value()->Read(0);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_NEAR(frame->gray.at(20, 20), 76, 3) << "red weighs 0.299";
}

TEST(SequenceWriterTest, StopsWhenAskedTo) {
  const TempFolder folder;
  SequenceWriterOptions options;
  size_t num_seen = 0;
  options.progress = [&](size_t num_written) {
    num_seen = num_written;
    return num_written < 2;
  };
  const Status status = WriteSequence(ShadedSequence(SensorKind::kMono), folder.File("visit"), options);
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(num_seen, 2U);
}

}  // namespace
}  // namespace mapp::sim
