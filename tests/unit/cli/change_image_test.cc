#include "cli/change_image.h"

#include "change_scene.h"
#include "cli/legend.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <cstdlib>
#include <fstream>

namespace mapp {
namespace {

constexpr int kPanelLeftPx = 1300;  // of the legend, in a picture of the usual size

cv::Mat DecodePicture(const StatusOr<std::string>& png, const char* name) {
  EXPECT_TRUE(png.ok()) << png.status();
  if (!png.ok()) return {};
  if (const char* folder = std::getenv("MAPP_TEST_CHANGE_PNGS")) {
    std::ofstream(std::string(folder) + "/" + name, std::ios::binary) << *png;
  }
  const std::vector<uint8_t> bytes(png->begin(), png->end());
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

int CountColor(const cv::Mat& bgr, Color color) {
  const cv::Vec3b exact(color.blue, color.green, color.red);
  cv::Mat mask;
  cv::inRange(bgr, exact, exact, mask);
  return cv::countNonZero(mask);
}

TEST(ChangeImageTest, ShowsEachKindInItsColor) {
  const cv::Mat image = DecodePicture(DrawChanges(ChangeScene().ToChangedMap(), {}), "changes.png");
  ASSERT_EQ(image.cols, 1600);
  ASSERT_EQ(image.rows, 1000);
  const cv::Mat map_area = image.colRange(0, kPanelLeftPx);
  for (const Color color : {kVanishedColor, kAppearedColor, kMovedFromColor, kMovedToColor}) {
    EXPECT_GT(CountColor(map_area, color), 400);
  }
}

TEST(ChangeImageTest, WithoutChangesThereIsTheMap) {
  ChangedMap map = ChangeScene().ToChangedMap();
  map.changes.clear();
  map.retired.clear();
  const cv::Mat image = DecodePicture(DrawChanges(map, {}), "none.png");
  const cv::Mat map_area = image.colRange(0, kPanelLeftPx);
  EXPECT_EQ(CountColor(map_area, kVanishedColor), 0);
  int num_gray = 0;
  for (uint8_t shade = 95; shade < 216; ++shade) num_gray += CountColor(map_area, {shade, shade, shade});
  EXPECT_GT(num_gray, 4000) << "points";
  EXPECT_FALSE(DecodePicture(DrawBeforeAndAfter(map, {}), "none-twice.png").empty());
  EXPECT_FALSE(DecodePicture(DrawChanges({}, {}), "nothing.png").empty());
}

TEST(ChangeImageTest, LeavesOutRetiredPointsThatNobodyKnows) {
  ChangedMap map = ChangeScene().ToChangedMap();
  map.retired.clear();
  map.points_then.reset();
  map.num_lost = 40;
  EXPECT_FALSE(DecodePicture(DrawChanges(map, {}), "lost.png").empty());
}

/// Pictures before and after of one change of the scene: left and right half without the legend.
std::pair<cv::Mat, cv::Mat> Halves(uint64_t change_id) {
  ChangedMap map = ChangeScene().ToChangedMap();
  std::erase_if(map.changes, [&](const ChangeSummary& change) { return change.id != change_id; });
  if (map.changes.front().applied_revision == 0) {
    map.points_then.reset();
    map.retired.clear();
  }
  const std::string name = "change-" + std::to_string(change_id) + ".png";
  const cv::Mat image = DecodePicture(DrawBeforeAndAfter(map, {}), name.c_str());
  return {image.colRange(0, kPanelLeftPx / 2), image.colRange(kPanelLeftPx / 2, kPanelLeftPx)};
}

TEST(ChangeImageTest, BeforeHasWhatVanishedAndAfterHasNot) {
  for (const uint64_t id : {1, 12}) {
    const auto [before, after] = Halves(id);
    EXPECT_GT(CountColor(before, kVanishedColor), 400) << "change " << id;
    EXPECT_EQ(CountColor(after, kVanishedColor), 0) << "change " << id;
    EXPECT_GT(CountColor(after, Tint(kVanishedColor)), 100) << "a pale outline where it was";
  }
}

TEST(ChangeImageTest, AfterHasWhatAppearedAndBeforeHasNot) {
  const auto [before, after] = Halves(2);
  EXPECT_EQ(CountColor(before, kAppearedColor), 0);
  EXPECT_GT(CountColor(after, kAppearedColor), 400);
}

TEST(ChangeImageTest, WhatMovedIsInBothAtItsPlace) {
  const auto [before, after] = Halves(3);
  EXPECT_GT(CountColor(before, kMovedFromColor), 400);
  EXPECT_EQ(CountColor(before, kMovedToColor), 0);
  EXPECT_GT(CountColor(after, kMovedToColor), 400);
  EXPECT_EQ(CountColor(after, kMovedFromColor), 0);
}

TEST(ChangeImageTest, BeforeAndAfterOfAllChanges) {
  const cv::Mat image = DecodePicture(DrawBeforeAndAfter(ChangeScene().ToChangedMap(), {}), "before-after.png");
  EXPECT_GT(CountColor(image.colRange(0, kPanelLeftPx / 2), kVanishedColor), 800) << "also what was accepted";
}

TEST(ChangeImageTest, LegendEndsAboveTheScaleBarHoweverMany) {
  ChangedMap map = ChangeScene().ToChangedMap();
  const ChangeSummary first = map.changes.front();
  for (uint64_t id = 100; id < 160; ++id) {
    map.changes.push_back(first);
    map.changes.back().id = id;
    map.changes.back().box_map_before->T_frame_box =
        Pose3(Eigen::Quaterniond::Identity(), {0.7 * double(id % 10) + 0.8, -0.4, 0.9 * double(id / 10 - 10) + 0.5});
    map.changes.back().box_map_before->size_m = {0.3, 0.3, 0.3};
  }
  const cv::Mat image = DecodePicture(DrawChanges(map, {}), "many.png");
  const cv::Mat above_bar = image(cv::Range(910, 920), cv::Range(kPanelLeftPx, 1600));
  EXPECT_EQ(CountColor(above_bar, kPanel), above_bar.rows * above_bar.cols);
}

TEST(ChangeImageTest, RefusesAbsurdSizes) {
  EXPECT_EQ(DrawChanges({}, {100, 1000}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(DrawBeforeAndAfter({}, {1000, 100'000}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(DrawBeforeAndAfter({}, {799, 1000}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(DecodePicture(DrawBeforeAndAfter(ChangeScene().ToChangedMap(), {800, 500}), "small.png").cols, 800);
}

}  // namespace
}  // namespace mapp
