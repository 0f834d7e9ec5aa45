#include "sim/room.h"

#include "sim/renderer.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/features2d.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>

namespace mapp::sim {
namespace {

constexpr uint64_t kSeed = 1;

struct OrbFeatures {
  std::vector<cv::KeyPoint> corners;
  cv::Mat descriptors;
};

OrbFeatures Extract(const GrayImage& image) {
  cv::Mat mat(image.height, image.width, CV_8UC1);
  std::ranges::copy(image.pixels, mat.ptr<uint8_t>());
  OrbFeatures features;
  cv::ORB::create(1000)->detectAndCompute(mat, cv::noArray(), features.corners, features.descriptors);
  return features;
}

/// Mutual best matches between a frame of `a` and one of `b`: how many there are, and how many of them join pixels
/// within 6 px of what true poses and depth say.
struct MatchCount {
  int num_matches = 0;
  int num_true = 0;
};
MatchCount Match(const Sequence& a, size_t frame_a, const Sequence& b, size_t frame_b) {
  constexpr float kMaxHamming = 50;
  const SequenceFrame image_a = a.Read(frame_a).value();
  const OrbFeatures features_a = Extract(image_a.gray);
  const OrbFeatures features_b = Extract(b.Read(frame_b).value().gray);
  const Pose3 T_b_a = b.ground_truth()[frame_b].T_world_camera.Inverse() * a.ground_truth()[frame_a].T_world_camera;
  std::vector<cv::DMatch> matches;
  cv::BFMatcher(cv::NORM_HAMMING, true).match(features_a.descriptors, features_b.descriptors, matches);
  MatchCount count;
  for (const cv::DMatch& match : matches) {
    if (match.distance > kMaxHamming) continue;
    ++count.num_matches;
    const cv::Point2f pixel_a = features_a.corners[static_cast<size_t>(match.queryIdx)].pt;
    const cv::Point2f pixel_b = features_b.corners[static_cast<size_t>(match.trainIdx)].pt;
    const float depth_m = image_a.depth_m.at(cvRound(pixel_a.x), cvRound(pixel_a.y));
    const Eigen::Vector3d p_b = T_b_a * (depth_m * a.camera().Unproject({pixel_a.x, pixel_a.y}));
    const Eigen::Vector2d expected_b = b.camera().Project(p_b);
    count.num_true += (expected_b - Eigen::Vector2d(pixel_b.x, pixel_b.y)).norm() < 6 ? 1 : 0;
  }
  return count;
}

std::unique_ptr<Sequence> Open(uint64_t seed, int session) {
  auto sequence = MakeRoomSequence({.seed = seed, .session = session, .num_threads = 2});
  EXPECT_TRUE(sequence.ok()) << sequence.status();
  return std::move(sequence).value();
}

class RoomTest : public testing::TestWithParam<std::pair<uint64_t, int>> {};

TEST_P(RoomTest, ViewsAreFullOfCornersAndClosedOnAllSides) {
  const auto sequence = Open(GetParam().first, GetParam().second);
  int num_frames = 0;
  int num_rich = 0;
  for (size_t i = 0; i < sequence->num_frames(); i += 10, ++num_frames) {
    const auto frame = sequence->Read(i);
    ASSERT_TRUE(frame.ok()) << frame.status();
    num_rich += Extract(frame->gray).corners.size() >= 800 ? 1 : 0;
    const auto [nearest, farthest] = std::ranges::minmax(frame->depth_m.pixels);
    EXPECT_GT(nearest, 0.3F) << "frame " << i;  // no hole, and the camera in no piece of furniture
    EXPECT_LT(farthest, 8.0F) << "frame " << i;
  }
  EXPECT_GE(10 * num_rich, 9 * num_frames);
}

INSTANTIATE_TEST_SUITE_P(Rooms, RoomTest,
                         testing::Values(std::pair<uint64_t, int>{1, 0}, std::pair<uint64_t, int>{1, 1},
                                         std::pair<uint64_t, int>{2, 0}, std::pair<uint64_t, int>{3, 2}));

/// Depth images of a session without noise, drawn at a quarter of the size.
struct DepthViews {
  Camera camera;
  std::vector<Pose3> T_world_camera;
  std::vector<DepthImage> depth_m;
};

DepthViews DrawDepth(const Renderer& renderer, int session, size_t every) {
  DepthViews views{{PinholeCamera{131.25, 131.25, 79.5, 59.5}, 160, 120}, {}, {}};
  const auto poses = RoomTrajectory(session);
  for (size_t i = 0; i < poses.size(); i += every) {
    auto frame = renderer.Render(views.camera, poses[i].T_world_camera);
    EXPECT_TRUE(frame.ok()) << frame.status();
    views.T_world_camera.push_back(poses[i].T_world_camera);
    views.depth_m.push_back(std::move(frame->depth_m));
  }
  return views;
}

bool Sees(const DepthViews& views, const Eigen::Vector3d& p_world) {
  for (size_t i = 0; i < views.depth_m.size(); ++i) {
    const Eigen::Vector3d p_camera = views.T_world_camera[i].Inverse() * p_world;
    if (p_camera.z() < 0.1) continue;
    const Eigen::Vector2d pixel = views.camera.Project(p_camera);
    if (!views.camera.Contains(pixel, 1)) continue;
    const float depth_m =
        views.depth_m[i].at(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
    if (std::abs(depth_m - p_camera.z()) < 0.05 * p_camera.z()) return true;
  }
  return false;
}

/// For each view of `later`, the share of its pixels that `earlier` saw.
std::vector<double> SharesSeen(const DepthViews& earlier, const DepthViews& later) {
  std::vector<double> shares;
  for (size_t i = 0; i < later.depth_m.size(); ++i) {
    int num_pixels = 0;
    int num_seen = 0;
    for (int y = 4; y < later.camera.height_px; y += 8) {
      for (int x = 4; x < later.camera.width_px; x += 8, ++num_pixels) {
        const Eigen::Vector3d ray = later.camera.Unproject({static_cast<double>(x), static_cast<double>(y)});
        num_seen += Sees(earlier, later.T_world_camera[i] * (later.depth_m[i].at(x, y) * ray)) ? 1 : 0;
      }
    }
    shares.push_back(static_cast<double>(num_seen) / num_pixels);
  }
  return shares;
}

TEST(RoomSessionsTest, TheSecondSessionSeesKnownPartlyKnownAndFreshPlaces) {
  const auto scene = BuildRoom(kSeed);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const auto renderer = MakeRasterRenderer(*scene, 2);
  const auto shares = SharesSeen(DrawDepth(*renderer, 0, 5), DrawDepth(*renderer, 1, 5));
  const auto known = std::ranges::count_if(shares, [](double share) { return share > 0.85; });
  const auto fresh = std::ranges::count_if(shares, [](double share) { return share < 0.2; });
  const auto num_views = static_cast<std::ptrdiff_t>(shares.size());
  EXPECT_GT(shares.front(), 0.85) << "the second session must start where it can be aligned";
  EXPECT_GE(known, num_views / 3);
  EXPECT_GE(fresh, 2);
  EXPECT_GE(num_views - known - fresh, 4);
}

TEST(RoomSequenceTest, IsTheSameEachTimeAndOtherwiseForAnotherSeedOrSession) {
  const auto first = Open(kSeed, 0)->Read(3);
  const auto again = MakeRoomSequence({.seed = kSeed, .session = 0, .num_threads = 1}).value()->Read(3);
  const auto other_room = Open(kSeed + 1, 0)->Read(3);
  ASSERT_TRUE(first.ok() && again.ok() && other_room.ok());
  EXPECT_EQ(first->gray.pixels, again->gray.pixels);
  EXPECT_EQ(first->depth_m.pixels, again->depth_m.pixels);
  EXPECT_NE(first->gray.pixels, other_room->gray.pixels);
}

TEST(RoomSessionsTest, ViewsMatchWithinAndBetweenSessionsButNotBetweenRooms) {
  const auto first = Open(kSeed, 0);
  const auto second = Open(kSeed, 1);
  EXPECT_GT(Match(*first, 0, *first, 5).num_true, 200);
  const MatchCount same_side = Match(*first, 40, *second, 0);
  EXPECT_GT(same_side.num_true, 200);
  const MatchCount nearer = Match(*first, 124, *second, 60);  // the same wall from 1.1 m elsewhere
  EXPECT_GT(nearer.num_true, 60);
  EXPECT_GT(nearer.num_true, nearer.num_matches * 3 / 4);
  EXPECT_LT(Match(*first, 60, *Open(kSeed + 1, 0), 60).num_matches, 80);
}

TEST(RoomSequenceTest, DescribesItself) {
  const auto sequence = Open(kSeed, 1);
  EXPECT_EQ(sequence->name(), "room");
  EXPECT_EQ(sequence->sensor(), SensorKind::kRgbd);
  EXPECT_FALSE(sequence->right_camera().has_value());
  EXPECT_TRUE(sequence->camera().Validate().ok());
  EXPECT_EQ(sequence->ground_truth().size(), sequence->num_frames());
  EXPECT_EQ(sequence->stamp_ns(7), sequence->ground_truth()[7].stamp_ns);
  EXPECT_EQ(sequence->Read(150).status().code(), absl::StatusCode::kOutOfRange);
}

TEST(RoomSequenceTest, RefusesBadOptions) {
  const Status session = MakeRoomSequence({.session = -1}).status();
  EXPECT_EQ(session.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(session.message()), testing::StartsWith("session: "));
  const Status threads = MakeRoomSequence({.num_threads = 0}).status();
  EXPECT_EQ(threads.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(threads.message()), testing::StartsWith("num_threads: "));
}

TEST(RoomSequenceTest, WrittenFolderReadsBackAsTheSameSequence) {
  const test::TempFolder folder;
  ASSERT_TRUE(WriteRoomSequence(folder.File("session"), {.seed = kSeed, .session = 1}).ok());
  const auto read = OpenSequence(folder.File("session"));
  ASSERT_TRUE(read.ok()) << read.status();
  const auto made = Open(kSeed, 1);
  EXPECT_EQ((*read)->sensor(), SensorKind::kRgbd);
  ASSERT_EQ((*read)->num_frames(), made->num_frames());
  EXPECT_EQ(Coefficients((*read)->camera().projection), Coefficients(made->camera().projection));
  ASSERT_EQ((*read)->ground_truth().size(), made->ground_truth().size());
  for (const size_t i : {size_t{0}, size_t{80}, size_t{149}}) {
    EXPECT_EQ((*read)->stamp_ns(i), made->stamp_ns(i));
    EXPECT_LT(Distance((*read)->ground_truth()[i].T_world_camera, made->ground_truth()[i].T_world_camera), 1e-5);
    const auto from_disk = (*read)->Read(i);
    const auto drawn = made->Read(i);
    ASSERT_TRUE(from_disk.ok() && drawn.ok());
    double difference = 0;
    for (size_t p = 0; p < drawn->gray.pixels.size(); ++p) {
      difference += std::abs(int{from_disk->gray.pixels[p]} - int{drawn->gray.pixels[p]});
      ASSERT_NEAR(from_disk->depth_m.pixels[p], drawn->depth_m.pixels[p], 1.01e-4);
    }
    EXPECT_LT(difference / static_cast<double>(drawn->gray.pixels.size()), 2.0) << "JPEG of quality 95";
  }
}

TEST(RoomSequenceTest, ReportsAFolderThatCannotBeMade) {
  const test::TempFolder folder;
  const std::string file = folder.Write("file", "not a folder");
  const Status status = WriteRoomSequence(file + "/session", {.seed = kSeed});
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr(file));
}

}  // namespace
}  // namespace mapp::sim
