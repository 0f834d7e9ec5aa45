#include "mapp/client/map_client.h"

#include "client_sdk/src/call_control.h"
#include "fake_map_service.h"
#include "mapp/base/bytes.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/tile_codec.h"
#include "synthetic_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace mapp {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

class MapClientTest : public testing::Test {
 protected:
  MapClientTest() {
    MapClientOptions options;
    options.server_address = server_.address();
    options.first_backoff = milliseconds(1);
    options.max_backoff = milliseconds(5);
    options.retry_for = milliseconds(300);
    client_ = MapClient::Create(options).value();
  }
  static std::string Packet(uint32_t number) { return EncodeKeyframe(TestKeyframe(number, Pose3(), 20)); }

  FakeMapService server_;
  std::unique_ptr<MapClient> client_;
};

TEST_F(MapClientTest, GivesUpWhenRetriesHaveTakenLongEnough) {
  server_.Change(
      [](FakeMapService::Script& script) { script.upload_errors.assign(100'000, grpc::StatusCode::UNAVAILABLE); });
  const Status status = client_->UploadKeyframe(Packet(0)).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(status.ToString(), HasSubstr(server_.address()));
  EXPECT_GT(client_->traffic().num_retries, 5U);
}

TEST_F(MapClientTest, WhatIsNotTransientIsNotRetried) {
  using grpc::StatusCode;
  for (const StatusCode code : {StatusCode::INVALID_ARGUMENT, StatusCode::RESOURCE_EXHAUSTED, StatusCode::NOT_FOUND,
                                StatusCode::FAILED_PRECONDITION, StatusCode::DATA_LOSS, StatusCode::INTERNAL}) {
    server_.Change([&](FakeMapService::Script& script) { script.upload_errors = {code}; });
    EXPECT_EQ(static_cast<int>(client_->UploadKeyframe(Packet(0)).status().code()), code);
  }
  EXPECT_EQ(client_->traffic().num_retries, 0U);
}

TEST_F(MapClientTest, OneAttemptIsOne) {
  server_.Change([](FakeMapService::Script& script) { script.shared_map_errors = {grpc::StatusCode::UNAVAILABLE}; });
  const auto map = client_->RequestSharedMap(SessionId(7), {}, Patience::kOneAttempt);
  EXPECT_EQ(map.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(client_->traffic().num_retries, 0U);
}

TEST_F(MapClientTest, CountsTheBytesOfEveryAttempt) {
  ASSERT_TRUE(client_->UploadKeyframe(Packet(0)).ok());
  const uint64_t once = client_->traffic().upload_bytes;
  EXPECT_GE(once, Packet(0).size());
  server_.Change([](FakeMapService::Script& script) { script.upload_errors = {grpc::StatusCode::UNAVAILABLE}; });
  ASSERT_TRUE(client_->UploadKeyframe(Packet(0)).ok());
  EXPECT_EQ(client_->traffic().upload_bytes, 3 * once);
}

TEST_F(MapClientTest, ASharedMapComesWhole) {
  server_.Change([](FakeMapService::Script& script) { script.tiles = {TestTile(Revision(4), 50)}; });
  const auto map = client_->RequestSharedMap(SessionId(7), {});
  ASSERT_TRUE(map.ok()) << map.status();
  ASSERT_THAT(map->tiles, SizeIs(1));
  EXPECT_EQ(map->tiles[0].tile.revision, Revision(4));
  EXPECT_THAT(map->tiles[0].tile.points, SizeIs(50));
  EXPECT_EQ(map->tiles[0].bytes, EncodeTile(TestTile(Revision(4), 50))) << "for a cache, as they were sent";
  EXPECT_TRUE(map->first_tile_after.has_value());
}

TEST_F(MapClientTest, ASharedMapSaysWhatBecameOfHeldTiles) {
  const Tile kept = TestTile(Revision(4), 50);
  server_.Change([&](FakeMapService::Script& script) { script.tiles = {kept}; });
  ClientSharedMapRequest request;
  request.held_tiles = {{TileKey{.x = 9}, Revision(2), 1}, {kept.key, kept.revision, Crc32c(EncodeTile(kept))}};
  const auto map = client_->RequestSharedMap(SessionId(7), request);
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(map->tiles, SizeIs(0));
  EXPECT_FALSE(map->first_tile_after.has_value());
  EXPECT_THAT(map->unchanged_held, ElementsAre(1));
  EXPECT_THAT(map->outdated_held, ElementsAre(0));
}

TEST_F(MapClientTest, WhatLiesAheadIsAskedForInTheFrameOfTheView) {
  ClientSharedMapRequest request;
  request.max_bytes = 100'000;
  request.look_ahead = {.distance_m = 12, .motion = {0, 0, 1.5}, .earlier_ways = true};
  ASSERT_TRUE(client_->RequestSharedMap(SessionId(7), request).ok());
  const v1::RequestSharedMapRequest sent = server_.shared_map_requests().back();
  EXPECT_EQ(sent.max_bytes(), 100'000U);
  EXPECT_FLOAT_EQ(sent.look_ahead().distance_m(), 12);
  EXPECT_DOUBLE_EQ(sent.look_ahead().motion().z_m(), 1.5);
  EXPECT_TRUE(sent.look_ahead().earlier_ways());
  request.look_ahead.distance_m = 0;
  ASSERT_TRUE(client_->RequestSharedMap(SessionId(7), request).ok());
  EXPECT_FALSE(server_.shared_map_requests().back().has_look_ahead());
}

TEST_F(MapClientTest, AnAnswerAboutTilesThatAreNotHeldIsRefused) {
  server_.Change([](FakeMapService::Script& script) { script.unchanged_held_beyond = true; });
  const auto map = client_->RequestSharedMap(SessionId(7), {});
  EXPECT_EQ(map.status().code(), absl::StatusCode::kInternal);
  EXPECT_THAT(std::string(map.status().message()), HasSubstr("summary.unchanged_held_tiles"));
}

TEST_F(MapClientTest, PosesOfASessionComeByKeyframe) {
  EXPECT_EQ(client_->GetSessionPoses(SessionId(7)).status().code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(client_->UploadKeyframe(Packet(0)).ok());
  ASSERT_TRUE(client_->UploadKeyframe(Packet(1)).ok());
  const Pose3 T_corrected_sent(Eigen::Quaterniond::Identity(), {0, 0, 0.25});
  server_.Change([&](FakeMapService::Script& script) { script.T_corrected_sent = T_corrected_sent; });
  const auto poses = client_->GetSessionPoses(server_.uploads()[0].session);
  ASSERT_TRUE(poses.ok()) << poses.status();
  ASSERT_THAT(*poses, SizeIs(2));
  const Keyframe sent = server_.uploads()[1];
  EXPECT_EQ((*poses)[1].number, sent.number);
  EXPECT_EQ((*poses)[1].stamp_ns, sent.stamp_ns);
  EXPECT_LT(Distance((*poses)[1].T_map_camera, T_corrected_sent * sent.T_frame_camera), 1e-9);
}

TEST_F(MapClientTest, CancelEndsRetriesAndLaterCalls) {
  server_.Stop();
  MapClientOptions options;
  options.server_address = server_.address();
  options.retry_for = std::chrono::minutes(10);
  const std::unique_ptr<MapClient> client = MapClient::Create(options).value();
  std::thread canceller([&] { client->Cancel(); });
  EXPECT_EQ(client->UploadKeyframe(Packet(0)).status().code(), absl::StatusCode::kCancelled);
  canceller.join();
  EXPECT_EQ(client->CloseSession(SessionId(7)).status().code(), absl::StatusCode::kCancelled);
}

TEST_F(MapClientTest, OptionsAreCheckedByName) {
  MapClientOptions options;
  options.call_timeout = milliseconds(0);
  EXPECT_THAT(MapClient::Create(options).status().ToString(), HasSubstr("call_timeout: "));
}

TEST(BackoffTest, DoublesUpToItsLimitWithJitter) {
  Backoff backoff(milliseconds(100), milliseconds(1000), 1);
  milliseconds full{100};
  for (int i = 0; i < 8; ++i) {
    const milliseconds pause = backoff.Next();
    EXPECT_GE(pause, full / 2);
    EXPECT_LE(pause, full);
    full = std::min(2 * full, milliseconds(1000));
  }
  backoff.Reset();
  EXPECT_LE(backoff.Next(), milliseconds(100));
}

TEST(CallControlTest, CancelEndsAPause) {
  CallControl control;
  std::thread canceller([&] { control.Cancel(); });
  EXPECT_FALSE(control.Pause(std::chrono::hours(1)));
  canceller.join();
  EXPECT_FALSE(control.Pause(std::chrono::hours(1)));
}

TEST(CallControlTest, APauseEndsByItself) {
  CallControl control;
  EXPECT_TRUE(control.Pause(milliseconds(1)));
}

}  // namespace
}  // namespace mapp
