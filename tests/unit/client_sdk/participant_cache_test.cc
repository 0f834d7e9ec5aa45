// What a participant keeps of shared maps, within a session and beyond it, and how far ahead it asks.

#include "mapp/base/bytes.h"
#include "mapp/codec/tile_codec.h"
#include "participant_fixture.h"
#include "test_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class ParticipantCacheTest : public ParticipantTest {
 protected:
  ParticipantCacheTest() { options_.tile_cache.folder = folder_.path(); }

  /// Ends the session, and begins another that comes to share the map, which is this tile now.
  void DriveAgain(const Tile& tile = TestTile(Revision(1))) {
    const Status closed = participant_->Close(kPatience, false);
    ASSERT_TRUE(closed.ok()) << closed;
    participant_.reset();
    server_.Change([&](FakeMapService::Script& script) { script.tiles = {tile}; });
    OpenAligned();
    HandIn(1);
    ASSERT_EQ(participant_->state(), ParticipantState::kSharing);
  }
  size_t NumHeldLast() const { return static_cast<size_t>(server_.shared_map_requests().back().held_tiles_size()); }

  TestFolder folder_;
};

TEST_F(ParticipantCacheTest, TheSecondDriveDownloadsNoTile) {
  OpenSharing();
  EXPECT_EQ(NumHeldLast(), 0U);
  EXPECT_EQ(participant_->stats().num_cached_tiles, 0U);
  const uint64_t first_bytes = participant_->stats().traffic.download_bytes;
  DriveAgain();
  const v1::RequestSharedMapRequest request = server_.shared_map_requests().back();
  ASSERT_EQ(request.held_tiles_size(), 1);
  EXPECT_EQ(request.held_tiles(0).revision(), 1U);
  EXPECT_EQ(request.held_tiles(0).crc32c(), Crc32c(EncodeTile(TestTile(Revision(1)))));
  EXPECT_EQ(participant_->stats().num_cached_tiles, 1U);
  EXPECT_LT(participant_->stats().traffic.download_bytes, 100U);
  EXPECT_GT(first_bytes, 1000U);
  ASSERT_THAT(adapter_.maps(), SizeIs(2));
  EXPECT_EQ(adapter_.maps()[1]->points.size(), 300U);
}

TEST_F(ParticipantCacheTest, AMapMadeAnewUnderTheNameHasNoneOfTheTiles) {
  OpenSharing();
  server_.Change([](FakeMapService::Script& script) { script.map_created_ns = 2000; });
  DriveAgain();
  EXPECT_EQ(NumHeldLast(), 0U);
}

TEST_F(ParticipantCacheTest, AServerThatDoesNotTellMapsApartIsAskedAsWithoutACache) {
  server_.Change([](FakeMapService::Script& script) { script.map_created_ns = 0; });
  OpenSharing();
  DriveAgain();
  EXPECT_EQ(NumHeldLast(), 0U);
}

TEST_F(ParticipantCacheTest, ADamagedTileIsFetchedAnew) {
  OpenSharing();
  folder_.Spoil("tile", TileKey{}.Packed());
  DriveAgain();
  EXPECT_EQ(NumHeldLast(), 0U);
  EXPECT_EQ(adapter_.maps()[1]->points.size(), 300U);
  DriveAgain();
  EXPECT_EQ(NumHeldLast(), 1U) << "and stored whole";
}

TEST_F(ParticipantCacheTest, AnOldTileIsReplaced) {
  OpenSharing();
  const Tile newer = TestTile(Revision(2), 250);
  DriveAgain(newer);
  EXPECT_EQ(NumHeldLast(), 1U);
  EXPECT_EQ(adapter_.maps().back()->points.size(), 250U);
  EXPECT_EQ(participant_->stats().num_cached_tiles, 0U);
  DriveAgain(newer);
  EXPECT_EQ(server_.shared_map_requests().back().held_tiles(0).revision(), 2U);
}

TEST_F(ParticipantCacheTest, WhatTheServerTellsToBeGoneIsNotNamedAgainInAnySession) {
  OpenSharing();
  v1::WatchSessionResponse gone;
  gone.mutable_tiles_changed()->add_keys(TileKey{}.Packed());
  gone.mutable_tiles_changed()->set_map_revision(2);
  server_.Send(gone);
  server_.Send(AlignedMessage(TestAlignment(), 77));  // once this is seen, the one before it has been, too
  while (participant_->stats().aligned_at_keyframe != 77U) std::this_thread::yield();
  server_.Change([](FakeMapService::Script& script) { script.tiles = {TestTile(Revision(2))}; });
  Frame(1, false);
  EXPECT_EQ(NumHeldLast(), 0U);
  EXPECT_THAT(adapter_.maps(), SizeIs(2));
}

TEST_F(ParticipantCacheTest, AFolderThatCannotBeUsedIsToldAtOnce) {
  folder_.ReplaceByFile();
  const auto opened = Participant::Open(client_options_, options_, TestCamera(), SensorKind::kRgbd, &adapter_);
  EXPECT_EQ(opened.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(opened.status().message()), HasSubstr("tile_cache.folder: " + folder_.path()));
  EXPECT_THAT(server_.opened(), IsEmpty()) << "before the server hears of it";
}

TEST_F(ParticipantCacheTest, AFolderThatFailsLaterCostsOnlyItsUse) {
  OpenAligned();
  folder_.ReplaceByFile();
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
  });
  HandIn(1);
  EXPECT_EQ(participant_->state(), ParticipantState::kSharing);
  EXPECT_THAT(participant_->stats().last_error, HasSubstr(folder_.path()));
}

TEST_F(ParticipantCacheTest, RefusesBoundsThatHoldNothing) {
  options_.tile_cache.max_bytes = 1000;
  EXPECT_THAT(std::string(options_.Validate().message()), HasSubstr("tile_cache.max_bytes: "));
  options_.tile_cache.folder.clear();
  EXPECT_TRUE(options_.Validate().ok()) << "no cache, no bounds";
  options_.max_shared_map_bytes = 1000;
  EXPECT_THAT(std::string(options_.Validate().message()), HasSubstr("max_shared_map_bytes: "));
  options_.max_shared_map_bytes = 0;
  for (const double meters : {-1.0, 100.5, std::nan("")}) {
    options_.look_ahead_m = meters;
    EXPECT_THAT(std::string(options_.Validate().message()), HasSubstr("look_ahead_m: ")) << meters;
  }
}

TEST_F(ParticipantTest, AsksForWhatLiesAheadOnItsWay) {
  options_.look_ahead_m = 7;
  options_.max_shared_map_bytes = 70'000;
  OpenAligned();
  for (uint32_t number = 1; number <= 5; ++number) HandIn(number);
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.tiles = {TestTile(Revision(1))};
  });
  HandIn(6);
  const v1::RequestSharedMapRequest request = server_.shared_map_requests().back();
  EXPECT_EQ(request.max_bytes(), 70'000U);
  EXPECT_FLOAT_EQ(request.look_ahead().distance_m(), 7);
  EXPECT_TRUE(request.look_ahead().earlier_ways());
  EXPECT_NEAR(request.look_ahead().motion().x_m(), 0.6, 1e-9) << "a keyframe every 10 cm to the right";
  EXPECT_NEAR(request.look_ahead().motion().z_m(), 0, 1e-9);
}

TEST_F(ParticipantTest, ABudgetTooSmallForTheNearestTileMeansMappingOnAndIsTold) {
  OpenAligned();
  server_.Change([](FakeMapService::Script& script) {
    script.samples_redundant = true;
    script.num_tiles_over_budget = 3;
  });
  HandIn(1);
  EXPECT_EQ(participant_->state(), ParticipantState::kExpanding);
  EXPECT_THAT(adapter_.maps(), IsEmpty());
  EXPECT_THAT(participant_->stats().last_error, HasSubstr("max_shared_map_bytes"));
}

}  // namespace
}  // namespace mapp
