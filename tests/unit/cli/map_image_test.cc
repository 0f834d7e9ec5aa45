#include "cli/map_image.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <cmath>
#include <cstdlib>
#include <fstream>

namespace mapp {
namespace {

/// A room of 8 x 6 m with two sessions: one walks around it whole, the other crosses it partly on a shared map.
MapImageContent RoomContent() {
  MapImageContent content;
  content.map.map.name = "room";
  content.map.map.revision = 17;
  Rng rng(1);
  for (int i = 0; i < 4000; ++i) {
    const double along = rng.Uniform(0, 1);
    const double height = rng.Uniform(-2.5, 0);
    const Eigen::Vector3d walls[] = {
        {8 * along, height, 0}, {8 * along, height, 6}, {0, height, 6 * along}, {8, height, 6 * along}};
    content.map.points.push_back({walls[i % 4], 3, 0.9F, 1});
  }
  for (uint32_t i = 0; i < 24; ++i) {
    const double angle = 2 * M_PI * i / 24;
    const Eigen::Quaterniond R_map_camera(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()));
    const Eigen::Vector3d p_map(4 + 2.5 * std::cos(angle), -1.3, 3 + 1.8 * std::sin(angle));
    content.map.frames.push_back({1, i, int64_t{i} * 500'000'000, Pose3(R_map_camera, p_map), i >= 16});
  }
  FrameLog log{2, {}};
  for (int i = 0; i < 60; ++i) {
    const Pose3 T_map_camera(Eigen::Quaterniond::Identity(), {1 + 0.1 * i, -1.2, 2 + std::sin(0.1 * i)});
    const bool shared = i >= 25;
    const bool keyframe = i % 6 == 0;
    const FrameRole role =
        !keyframe ? FrameRole::kOrdinary : (shared ? FrameRole::kSharedKeyframe : FrameRole::kKeyframe);
    log.frames.push_back({int64_t{i} * 66'000'000, T_map_camera, shared, role});
    if (role == FrameRole::kKeyframe) {
      content.map.frames.push_back({2, static_cast<uint32_t>(i / 6), log.frames.back().stamp_ns, T_map_camera, i > 10});
    }
  }
  content.logs.push_back(log);
  content.sessions.resize(2);
  content.sessions[0].id = 1;
  content.sessions[0].device = "first";
  content.sessions[1].id = 2;
  content.sessions[1].device = "second";
  return content;
}

cv::Mat Decode(const std::string& png) {
  const std::vector<uint8_t> bytes(png.begin(), png.end());
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

int CountPixels(const cv::Mat& bgr, const cv::Vec3b& color) {
  cv::Mat mask;
  cv::inRange(bgr, color, color, mask);
  return cv::countNonZero(mask);
}

TEST(MapImageTest, ShowsPointsAndBothSessionsInTheirColors) {
  const StatusOr<std::string> png = DrawMap(RoomContent(), {});
  ASSERT_TRUE(png.ok()) << png.status();
  if (const char* file = std::getenv("MAPP_TEST_MAP_PNG")) std::ofstream(file, std::ios::binary) << *png;

  const cv::Mat image = Decode(*png);
  ASSERT_EQ(image.cols, 1600);
  ASSERT_EQ(image.rows, 1000);
  const cv::Mat map_area = image.colRange(0, 1290);
  EXPECT_GT(CountPixels(map_area, {178, 114, 0}), 1000) << "first session";
  EXPECT_GT(CountPixels(map_area, {0, 94, 213}), 1000) << "second session";
  int num_gray = 0;
  for (uint8_t shade = 95; shade < 216; ++shade) num_gray += CountPixels(map_area, {shade, shade, shade});
  EXPECT_GT(num_gray, 4000) << "points";
}

TEST(MapImageTest, UnderlaysStretchesOnASharedMap) {
  MapImageContent content = RoomContent();
  const cv::Vec3b tint(160, 195, 240);  // 3/8 of the second session's color
  const StatusOr<std::string> with = DrawMap(content, {});
  for (LoggedFrame& frame : content.logs[0].frames) frame.on_shared_map = false;
  const StatusOr<std::string> without = DrawMap(content, {});
  ASSERT_TRUE(with.ok() && without.ok());
  EXPECT_GT(CountPixels(Decode(*with), tint), 500);
  EXPECT_LT(CountPixels(Decode(*without), tint), 50) << "smooth edges may hit it by chance";
}

TEST(MapImageTest, DrawsAnEmptyMap) {
  MapImageContent content;
  content.map.map.name = "Küche";
  const StatusOr<std::string> png = DrawMap(content, {400, 300});
  ASSERT_TRUE(png.ok()) << png.status();
  EXPECT_EQ(Decode(*png).cols, 400);
}

TEST(MapImageTest, RefusesAbsurdSizes) {
  const Status status = DrawMap({}, {100, 1000}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(std::string(status.message()).rfind("width_px:", 0), 0) << status;
  EXPECT_EQ(DrawMap({}, {1000, 100'000}).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp
