#include "server/service/look_ahead.h"

#include "mapp/map/tile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

/// At (x, 0, z) of a map whose y points down, looking along +z turned by `yaw`.
Pose3 Stand(double x, double z, double yaw = 0) {
  return Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY())), {x, 0, z});
}

const Eigen::Vector3d kOnward = Eigen::Vector3d::UnitZ();
const Eigen::Vector3d kStandingStill = Eigen::Vector3d::Zero();

/// Frames of a session on its way, in the order of its keyframes.
std::vector<FrameRecord> Way(SessionId session, const std::vector<Pose3>& T_map_camera) {
  std::vector<FrameRecord> frames;
  for (const Pose3& pose : T_map_camera) {
    FrameRecord frame;
    frame.session = session;
    frame.number = static_cast<uint32_t>(frames.size());
    frame.in_map = true;
    frame.T_frame_camera = pose;
    frames.push_back(frame);
  }
  return frames;
}
/// Along +z at `x`, a frame a metre.
std::vector<FrameRecord> Aisle(SessionId session, double x, int num_frames) {
  std::vector<Pose3> poses;
  for (int i = 0; i < num_frames; ++i) poses.push_back(Stand(x, i));
  return Way(session, poses);
}
std::vector<FrameRecord> operator+(std::vector<FrameRecord> a, const std::vector<FrameRecord>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}
double Farthest(const std::vector<WayPose>& ways) {
  double way_m = 0;
  for (const WayPose& pose : ways) way_m = std::max(way_m, pose.way_m);
  return way_m;
}

TEST(StraightAheadTest, GoesOnAsTheCameraMovesLookingAsItDoes) {
  const Pose3 T_map_camera = Stand(1, 2, 0.4);
  const auto way = StraightAhead(T_map_camera, {3, 0, 0}, 7);
  ASSERT_THAT(way, SizeIs(3));
  for (const WayPose& pose : way) {
    EXPECT_EQ(RotationAngle(pose.T_map_camera, T_map_camera), 0);
    EXPECT_LT((pose.T_map_camera.translation() - Eigen::Vector3d(1 + pose.way_m, 0, 2)).norm(), 1e-9);
  }
  EXPECT_DOUBLE_EQ(Farthest(way), 6);
}

TEST(StraightAheadTest, WhoStandsStillHasNoWay) {
  EXPECT_THAT(StraightAhead(Stand(0, 0), kStandingStill, 50), IsEmpty());
  EXPECT_THAT(StraightAhead(Stand(0, 0), kOnward, 1), IsEmpty()) << "what is so near is in view";
}

TEST(EarlierWaysTest, FollowsTheOneWhoCameByRoundTheCorner) {
  std::vector<Pose3> poses;
  for (int i = 0; i <= 4; ++i) poses.push_back(Stand(0, i));
  for (int i = 1; i <= 8; ++i) poses.push_back(Stand(i, 4, M_PI / 2));
  const auto frames = Way(SessionId(1), poses);
  const auto ways = EarlierWays(frames, Stand(0.5, 1), kOnward, 6);
  ASSERT_FALSE(ways.empty());
  EXPECT_LE(Farthest(ways), 6);
  EXPECT_GT(Farthest(ways), 4);
  const Pose3& last = ways.back().T_map_camera;
  EXPECT_GT(last.translation().x(), 1);
  EXPECT_LT(RotationAngle(last, Stand(0, 0, M_PI / 2)), 1e-9) << "where straight on would not look";
  EXPECT_TRUE(std::ranges::is_sorted(ways, {}, &WayPose::way_m));
}

TEST(EarlierWaysTest, TheOrderIsThatOfTheKeyframesNotOfTheRecords) {
  auto frames = Aisle(SessionId(1), 0, 12);
  const auto in_order = EarlierWays(frames, Stand(0, 0), kOnward, 10);
  std::ranges::reverse(frames);
  const auto reversed = EarlierWays(frames, Stand(0, 0), kOnward, 10);
  ASSERT_EQ(reversed.size(), in_order.size());
  for (size_t i = 0; i < in_order.size(); ++i) EXPECT_EQ(reversed[i].way_m, in_order[i].way_m);
}

TEST(EarlierWaysTest, OthersDoNotCount) {
  const auto frames = Aisle(SessionId(1), 0, 12);
  EXPECT_THAT(EarlierWays(frames, Stand(4.5, 3), kOnward, 10), IsEmpty()) << "nobody came so near";
  EXPECT_THAT(EarlierWays(frames, Stand(0, 3, M_PI), -kOnward, 10), IsEmpty()) << "they came the other way";
  EXPECT_THAT(EarlierWays(frames, Stand(0, 3), -kOnward, 10), IsEmpty()) << "backwards";
  EXPECT_THAT(EarlierWays(frames, Stand(0, 30), kOnward, 10), IsEmpty()) << "beyond their end";
  EXPECT_THAT(EarlierWays({}, Stand(0, 0), kOnward, 10), IsEmpty());
  EXPECT_THAT(EarlierWays(Aisle(SessionId(1), 0, 1), Stand(0, 0), kOnward, 10), IsEmpty()) << "one frame leads nowhere";
}

TEST(EarlierWaysTest, WhoStandsStillMayGoAnyWayThatOthersWentLookingAlike) {
  EXPECT_FALSE(EarlierWays(Aisle(SessionId(1), 0, 12), Stand(0, 3), kStandingStill, 10).empty());
}

TEST(EarlierWaysTest, EndsWhereTheWayHasAGap) {
  const auto frames = Way(SessionId(1), {Stand(0, 0), Stand(0, 2), Stand(0, 4), Stand(0, 12), Stand(0, 14)});
  EXPECT_DOUBLE_EQ(Farthest(EarlierWays(frames, Stand(0, 0), kOnward, 50)), 4);
}

TEST(EarlierWaysTest, OfACrowdTheNearestFewAreFollowed) {
  std::vector<FrameRecord> frames;
  for (int i = 0; i < 9; ++i) frames = frames + Aisle(SessionId(static_cast<uint64_t>(i + 1)), 0.3 * i, 5);
  const auto ways = EarlierWays(frames, Stand(0, 0), kOnward, 10);
  EXPECT_FALSE(ways.empty());
  for (const WayPose& pose : ways) EXPECT_LT(pose.T_map_camera.translation().x(), 0.3 * 3.5);
}

TEST(TilesAheadTest, EachTileOnceThoseMetFirstFirst) {
  const ViewCone cone{Stand(4, 4), 20, 1.2};
  const TileGrid grid{8};
  const auto way = StraightAhead(Stand(4, 4), kOnward, 20);
  const std::vector<TileKey> ahead = TilesAhead(way, cone, grid);
  auto sorted = ahead;
  std::ranges::sort(sorted);
  EXPECT_TRUE(std::ranges::adjacent_find(sorted) == sorted.end());
  const auto position = [&](int32_t z) {
    return std::ranges::find(ahead, TileKey{.x = 0, .y = 0, .z = z}) - ahead.begin();
  };
  const std::vector<TileKey> in_view = TilesInView(cone, grid);
  EXPECT_EQ(std::ranges::find(in_view, TileKey{.x = 0, .y = 0, .z = 4}), in_view.end());
  EXPECT_LT(position(3), position(4));
  EXPECT_LT(position(4), position(5));
  EXPECT_LT(position(5), static_cast<std::ptrdiff_t>(ahead.size()));
  EXPECT_THAT(TilesAhead({}, cone, grid), IsEmpty());
}

}  // namespace
}  // namespace mapp
