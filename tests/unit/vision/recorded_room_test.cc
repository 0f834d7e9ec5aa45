#include "datasets/sequence.h"
#include "vision/matching.h"
#include "vision/orb_extractor.h"
#include "vision/place_index.h"
#include "vision/robust_estimators.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>

namespace mapp {
namespace {

namespace fs = std::filesystem;

struct RoomFrame {
  SequenceFrame images;
  Pose3 T_world_camera;
  std::vector<Feature> features;
  std::vector<OrbDescriptor> descriptors;
};

/// Sessions a and c of a recorded kitchen, RGB-D with true poses: c sees much of a again, later.
class RecordedRoomTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const char* configured = std::getenv("MAPP_DATA_DIR");
    const fs::path data =
        configured != nullptr ? fs::path(configured) : fs::path(MAPP_SOURCE_DIR) / ".." / "shared/data";
    if (!fs::exists(data / "redkitchen")) return;
    session_a_ = Load(data / "redkitchen/a", 5);
    session_c_ = Load(data / "redkitchen/c", 10);
  }

  void SetUp() override {
    if (session_a_.empty()) GTEST_SKIP() << "no recorded room: set MAPP_DATA_DIR to the folder with redkitchen/";
  }

  static std::vector<RoomFrame> Load(const fs::path& folder, size_t step) {
    const auto sequence = OpenSequence(folder.string());
    EXPECT_TRUE(sequence.ok()) << sequence.status();
    if (!sequence.ok()) return {};
    const auto extractor = OrbExtractor::Create({});
    EXPECT_TRUE(extractor.ok()) << extractor.status();
    camera_ = (*sequence)->camera().Undistorted();
    std::vector<RoomFrame> frames;
    for (size_t i = 0; i < (*sequence)->num_frames(); i += step) {
      auto images = (*sequence)->Read(i);
      EXPECT_TRUE(images.ok()) << images.status();
      RoomFrame frame;
      frame.images = std::move(images).value();
      frame.T_world_camera = (*sequence)->ground_truth().at(i).T_world_camera;
      auto features = (*extractor)->Extract(frame.images.gray.View());
      EXPECT_TRUE(features.ok()) << features.status();
      frame.features = std::move(features).value();
      for (const Feature& feature : frame.features) frame.descriptors.push_back(feature.descriptor);
      frames.push_back(std::move(frame));
    }
    return frames;
  }

  /// Point at a pixel in the camera's frame; none without a depth reading.
  static std::optional<Eigen::Vector3d> PointAt(const RoomFrame& frame, double u_px, double v_px) {
    const DepthImage& depth = frame.images.depth_m;
    const int x = std::clamp(static_cast<int>(std::lround(u_px)), 0, depth.width - 1);
    const int y = std::clamp(static_cast<int>(std::lround(v_px)), 0, depth.height - 1);
    const double depth_m = depth.at(x, y);
    if (depth_m <= 0) return std::nullopt;
    return camera_.Unproject({u_px, v_px}) * depth_m;
  }

  /// Share of the query's view that the other frame sees too, by depth and true poses.
  static double SharedView(const RoomFrame& query, const RoomFrame& other) {
    const Pose3 T_other_query = other.T_world_camera.Inverse() * query.T_world_camera;
    int num_seen = 0;
    int num_readings = 0;
    for (int v = 20; v < 480; v += 40) {
      for (int u = 20; u < 640; u += 40) {
        const auto p_query = PointAt(query, u, v);
        if (!p_query) continue;
        ++num_readings;
        const Eigen::Vector3d p_other = T_other_query * *p_query;
        if (p_other.z() < 0.1) continue;
        const Eigen::Vector2d pixel = camera_.Project(p_other);
        if (pixel.x() < 0 || pixel.x() > 639 || pixel.y() < 0 || pixel.y() > 479) continue;
        const auto seen = PointAt(other, pixel.x(), pixel.y());
        if (seen && std::abs(seen->z() - p_other.z()) < 0.15) ++num_seen;
      }
    }
    return num_readings > 0 ? static_cast<double>(num_seen) / num_readings : 0.0;
  }

  static PinholeCamera camera_;
  static std::vector<RoomFrame> session_a_, session_c_;
};

PinholeCamera RecordedRoomTest::camera_;
std::vector<RoomFrame> RecordedRoomTest::session_a_;
std::vector<RoomFrame> RecordedRoomTest::session_c_;

/// A third of a second apart. Reference: OpenCV's own ORB detector gives 270 correct matches a pair here.
TEST_F(RecordedRoomTest, MatchesNeighboringFramesCorrectly) {
  constexpr double kMaxError_px = 6.0;  // the true poses reproject within about 1.5 px; corners of coarse levels add 3
  int num_correct = 0;
  int num_checked = 0;
  for (size_t i = 0; i + 1 < session_a_.size(); ++i) {
    const RoomFrame& query = session_a_[i];
    const RoomFrame& train = session_a_[i + 1];
    const Pose3 T_train_query = train.T_world_camera.Inverse() * query.T_world_camera;
    for (const Match& match : MatchDescriptors(query.descriptors, train.descriptors, {})) {
      const Keypoint& from = query.features[static_cast<size_t>(match.query_idx)].keypoint;
      const Keypoint& to = train.features[static_cast<size_t>(match.train_idx)].keypoint;
      const auto p_query = PointAt(query, from.u_px, from.v_px);
      if (!p_query) continue;
      ++num_checked;
      const Eigen::Vector2d expected = camera_.Project(T_train_query * *p_query);
      if ((expected - Eigen::Vector2d(to.u_px, to.v_px)).norm() < kMaxError_px) ++num_correct;
    }
  }
  const double num_pairs = static_cast<double>(session_a_.size() - 1);
  RecordProperty("correct_matches_per_pair", std::to_string(num_correct / num_pairs));
  EXPECT_GT(num_correct / num_pairs, 240.0);
  EXPECT_GT(num_correct, 0.84 * num_checked);
}

TEST_F(RecordedRoomTest, RecognizesPlacesOfAnotherVisit) {
  PlaceIndex index(PlaceIndex::Options{});
  for (size_t i = 0; i < session_a_.size(); ++i) index.Add(i, session_a_[i].descriptors);
  int num_queries = 0;
  int num_found = 0;
  for (const RoomFrame& query : session_c_) {
    const auto sees_again = [&](const RoomFrame& frame) { return SharedView(query, frame) > 0.4; };
    if (std::none_of(session_a_.begin(), session_a_.end(), sees_again)) continue;
    ++num_queries;
    const auto candidates = index.Query(query.descriptors, 5);
    num_found += std::any_of(candidates.begin(), candidates.end(),
                             [&](const auto& candidate) { return sees_again(session_a_[candidate.frame]); });
  }
  ASSERT_GT(num_queries, 3);
  EXPECT_EQ(num_found, num_queries);
}

TEST_F(RecordedRoomTest, LocatesAFrameFromThePointsOfItsNeighbor) {
  for (size_t i = 0; i + 1 < session_a_.size(); i += 4) {
    const RoomFrame& map = session_a_[i];
    const RoomFrame& query = session_a_[i + 1];
    std::vector<Eigen::Vector3d> p_world;
    std::vector<Eigen::Vector2d> pixels;
    for (const Match& match : MatchDescriptors(map.descriptors, query.descriptors, {})) {
      const Keypoint& from = map.features[static_cast<size_t>(match.query_idx)].keypoint;
      const Keypoint& to = query.features[static_cast<size_t>(match.train_idx)].keypoint;
      const auto p_map = PointAt(map, from.u_px, from.v_px);
      if (!p_map) continue;
      p_world.push_back(map.T_world_camera * *p_map);
      pixels.emplace_back(to.u_px, to.v_px);
    }
    const auto result = EstimatePose(camera_, p_world, pixels, 4.0, {});
    ASSERT_TRUE(result.has_value()) << "frame " << i;
    EXPECT_LT(Distance(result->T_world_camera, query.T_world_camera), 0.06) << "frame " << i;
    EXPECT_LT(RotationAngle(result->T_world_camera, query.T_world_camera), 0.03) << "frame " << i;
  }
}

}  // namespace
}  // namespace mapp
