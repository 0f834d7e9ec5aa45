// RequestSharedMap: what is sent, in which order, and what is said of the tiles that the device holds.

#include "mapp/base/bytes.h"
#include "tests/unit/server/views_fixture.h"

#include <gmock/gmock.h>

#include <algorithm>

namespace mapp::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

using SharedMapTest = ViewsTest;

TEST_F(SharedMapTest, HoldsEveryPointOfTheTilesNearestFirst) {
  std::vector<Tile> tiles;
  const SharedMapResult result = MustReceive(Request(seen_), &tiles);
  EXPECT_EQ(result.num_tiles_sent, tiles.size());
  EXPECT_EQ(result.num_tiles_over_budget, 0U);
  EXPECT_EQ(result.map_revision, Map().revision);
  size_t num_points = 0;
  double previous = 0;
  for (const Tile& tile : tiles) {
    EXPECT_TRUE(CheckConsistency(tile).empty());
    num_points += tile.points.size();
    const double distance = TileGrid{tile.edge_m}.BoxOf(tile.key).exteriorDistance(seen_.translation());
    EXPECT_GE(distance, previous);
    previous = distance;
  }
  EXPECT_EQ(static_cast<int64_t>(num_points), Map().num_points) << "the cone meets all of this small map's tiles";
}

TEST_F(SharedMapTest, HeldTilesAreNotSentAgainUntilTheyChange) {
  std::vector<Tile> tiles;
  MustReceive(Request(seen_), &tiles);
  SharedMapInput request = Request(seen_);
  for (const Tile& tile : tiles) request.held_tiles.push_back({tile.key, tile.revision});
  std::vector<Tile> again;
  const SharedMapResult result = MustReceive(request, &again);
  EXPECT_TRUE(again.empty());
  EXPECT_EQ(result.num_tiles_unchanged, tiles.size());

  MustUpload(world_, seen_, session_, 3);
  MustReceive(request, &again);
  EXPECT_FALSE(again.empty());
}

TEST_F(SharedMapTest, StoredBytesAreServedAsTheyAre) {
  std::vector<Tile> tiles;
  MustReceive(Request(seen_), &tiles);
  service_->Shutdown();  // waits for the thread that stores encoded tiles, or drops what it has not begun
  std::vector<Tile> again;
  MustReceive(Request(seen_), &again);
  ASSERT_EQ(again.size(), tiles.size());
  for (size_t i = 0; i < tiles.size(); ++i) EXPECT_EQ(EncodeTile(again[i]), EncodeTile(tiles[i]));
}

TEST_F(SharedMapTest, BudgetEndsTheStream) {
  std::vector<Tile> all;
  MustReceive(Request(seen_), &all);
  ASSERT_GE(all.size(), 2U);
  SharedMapInput request = Request(seen_);
  request.max_bytes = EncodeTile(all[0]).size() + 1;
  std::vector<Tile> some;
  const SharedMapResult result = MustReceive(request, &some);
  ASSERT_EQ(some.size(), 1U);
  EXPECT_EQ(some[0].key, all[0].key);
  EXPECT_EQ(result.num_tiles_over_budget, all.size() - 1);
}

TEST_F(SharedMapTest, ADeviceIsNotSentWhatItAloneHasSeen) {
  SharedMapInput request = Request(seen_);
  request.min_seen_by_others = 0.5;
  std::vector<Tile> tiles;
  const SharedMapResult to_founder = MustReceive(request, &tiles);
  EXPECT_TRUE(to_founder.is_own_map);
  EXPECT_TRUE(tiles.empty());
  EXPECT_GT(to_founder.map_revision.value(), 0U);

  const SessionId other = Open();
  Align(other);
  request.session = other;
  EXPECT_FALSE(MustReceive(request, &tiles).is_own_map);
  EXPECT_FALSE(tiles.empty());
  // What two have seen is another's map for either.
  MustUpload(world_, seen_, other, 0);
  request.session = session_;
  EXPECT_FALSE(MustReceive(request, &tiles).is_own_map);
}

TEST_F(SharedMapTest, StopsWithTheReceiversError) {
  const StatusOr<SharedMapResult> result = service_->RequestSharedMap(
      context_, Request(seen_), [](const std::string&) { return absl::CancelledError("the caller is gone"); });
  EXPECT_EQ(result.status().code(), absl::StatusCode::kCancelled);
  SharedMapInput narrow = Request(seen_);
  narrow.oversharing = 0.5;
  EXPECT_EQ(
      service_->RequestSharedMap(context_, narrow, [](const std::string&) { return absl::OkStatus(); }).status().code(),
      absl::StatusCode::kInvalidArgument);
}

/// A tile as a device names it.
HeldTile Held(const Tile& tile) { return {tile.key, tile.revision, Crc32c(EncodeTile(tile))}; }

std::vector<TileKey> KeysOf(const std::vector<Tile>& tiles) {
  std::vector<TileKey> keys;
  for (const Tile& tile : tiles) keys.push_back(tile.key);
  return keys;
}

TEST_F(SharedMapTest, HeldTilesAreToldByTheirPlaceInTheRequest) {
  std::vector<Tile> tiles;
  MustReceive(Request(seen_), &tiles);
  ASSERT_GE(tiles.size(), 2U);
  SharedMapInput request = Request(seen_);
  Tile outdated = tiles[0];
  outdated.revision = Revision(0);
  Tile emptied = tiles[0];
  emptied.key.y = 1;  // below the room's floor, but within the view's range
  Tile far_away = tiles[0];
  far_away.key.x += 1000;
  request.held_tiles = {Held(far_away), Held(outdated), Held(emptied), Held(tiles[1])};
  std::vector<Tile> sent;
  const SharedMapResult result = MustReceive(request, &sent);
  EXPECT_THAT(result.unchanged_held, ElementsAre(3));
  EXPECT_THAT(result.outdated_held, ElementsAre(2)) << "the outdated one was sent anew, the far one not looked at";
  EXPECT_EQ(sent.size(), tiles.size() - 1);
  EXPECT_EQ(sent[0].key, tiles[0].key);
  EXPECT_EQ(result.num_tiles_unchanged, 1U);
}

TEST_F(SharedMapTest, TheSameRevisionOfOtherBytesIsSentAnew) {
  std::vector<Tile> tiles;
  MustReceive(Request(seen_), &tiles);
  SharedMapInput request = Request(seen_);
  for (const Tile& tile : tiles) request.held_tiles.push_back(Held(tile));
  std::vector<Tile> sent;
  EXPECT_EQ(MustReceive(request, &sent).num_tiles_unchanged, tiles.size());
  // As after a backup from before was restored and the revisions were given out again.
  *request.held_tiles[0].crc32c ^= 1;
  const SharedMapResult result = MustReceive(request, &sent);
  EXPECT_THAT(KeysOf(sent), ElementsAre(tiles[0].key));
  EXPECT_EQ(result.num_tiles_unchanged, tiles.size() - 1);
  EXPECT_THAT(result.outdated_held, IsEmpty());
}

TEST_F(SharedMapTest, HeldTilesCostNoBudgetAndWhatIsOutdatedIsToldEvenBeyondIt) {
  std::vector<Tile> all;
  MustReceive(Request(seen_), &all);
  ASSERT_GE(all.size(), 3U);
  SharedMapInput request = Request(seen_);
  request.max_bytes = 1;
  Tile outdated = all[1];
  outdated.revision = Revision(0);
  request.held_tiles = {Held(outdated), Held(all.back())};
  std::vector<Tile> sent;
  const SharedMapResult result = MustReceive(request, &sent);
  EXPECT_THAT(sent, IsEmpty());
  EXPECT_THAT(result.unchanged_held, ElementsAre(1));
  EXPECT_THAT(result.outdated_held, ElementsAre(0));
  EXPECT_EQ(result.num_tiles_over_budget, all.size() - 1);
}

TEST_F(SharedMapTest, WhatLiesAheadFollowsWhatIsInView) {
  // The room's right half is out of view.
  const Pose3 to_the_left = SyntheticWorld::Stand(-3.5, 0.5, -1);
  std::vector<Tile> in_view;
  MustReceive(Request(to_the_left), &in_view);
  SharedMapInput request = Request(to_the_left);
  request.look_ahead = {.distance_m = 6, .motion = {1, 0, 0}, .earlier_ways = false};
  std::vector<Tile> all;
  const SharedMapResult result = MustReceive(request, &all);
  ASSERT_GT(all.size(), in_view.size());
  EXPECT_EQ(result.num_tiles_sent_ahead, all.size() - in_view.size());
  for (size_t i = 0; i < in_view.size(); ++i) EXPECT_EQ(all[i].key, in_view[i].key);

  // A budget takes what is ahead first.
  request.max_bytes = 0;
  for (const Tile& tile : in_view) request.max_bytes += EncodeTile(tile).size();
  std::vector<Tile> within;
  EXPECT_EQ(MustReceive(request, &within).num_tiles_sent_ahead, 0U);
  EXPECT_EQ(KeysOf(within), KeysOf(in_view));
}

TEST_F(SharedMapTest, WhereEarlierSessionsWentOnIsAhead) {
  // Others came by who then turned to the right.
  const Pose3 to_the_left = SyntheticWorld::Stand(-3.5, 0.5, -1);
  const SessionId other = Open();
  Align(other);
  MustUpload(world_, SyntheticWorld::Stand(-3, 0, -0.2), other, 0);
  MustUpload(world_, SyntheticWorld::Stand(-1, 0, 0.5), other, 1);
  MustUpload(world_, SyntheticWorld::Stand(1, 0, 1), other, 2);
  SharedMapInput request = Request(to_the_left);
  request.look_ahead = {.distance_m = 8, .motion = {0, 0, 0}, .earlier_ways = false};
  std::vector<Tile> tiles;
  EXPECT_EQ(MustReceive(request, &tiles).num_tiles_sent_ahead, 0U) << "a device that stands still has no way";
  request.look_ahead.earlier_ways = true;
  EXPECT_GT(MustReceive(request, &tiles).num_tiles_sent_ahead, 0U);
}

TEST_F(SharedMapTest, WhereNothingIsInViewNothingIsSentAtAll) {
  SharedMapInput request = Request(SyntheticWorld::Stand(0, 60, 0));
  request.look_ahead = {.distance_m = 100, .motion = {0, 0, -1}, .earlier_ways = true};
  std::vector<Tile> tiles;
  const SharedMapResult result = MustReceive(request, &tiles);
  EXPECT_THAT(tiles, IsEmpty());
  EXPECT_EQ(result.num_tiles_unchanged + result.num_tiles_over_budget, 0U) << "new ground";
}

TEST_F(SharedMapTest, TheWayIsToldInTheFrameOfTheView) {
  const SessionId turned = Open();
  const Pose3 T_map_session = SyntheticWorld::Stand(0, 0, 3.14159 / 2);
  const Status aligned = store_->Write(context_, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(turned));
    record.T_map_session = T_map_session;
    record.aligned_at_keyframe = 0;
    return writer.UpdateSession(record);
  });
  ASSERT_TRUE(aligned.ok()) << aligned;
  SharedMapInput in_map = Request(SyntheticWorld::Stand(-3.5, 0.5, -1));
  in_map.session = turned;
  in_map.look_ahead = {.distance_m = 6, .motion = {1, 0, 0}, .earlier_ways = false};
  SharedMapInput in_session = in_map;
  in_session.view.pose_frame = PoseFrame::kSession;
  in_session.view.T_frame_camera = T_map_session.Inverse() * in_map.view.T_frame_camera;
  in_session.look_ahead.motion = T_map_session.rotation().inverse() * in_map.look_ahead.motion;
  in_map.view.pose_frame = PoseFrame::kMap;
  std::vector<Tile> by_map, by_session;
  MustReceive(in_map, &by_map);
  MustReceive(in_session, &by_session);
  EXPECT_EQ(KeysOf(by_session), KeysOf(by_map));
}

}  // namespace
}  // namespace mapp::testing
