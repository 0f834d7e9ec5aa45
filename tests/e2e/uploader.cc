#include "tests/e2e/uploader.h"

#include "mapp/codec/keyframe_codec.h"
#include "tests/support/synthetic_world.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace mapp {

Uploader::Uploader(const UploaderOptions& options) : options_(options) {
  MapClientOptions client_options;
  client_options.server_address = options.server;
  client_options.first_backoff = std::chrono::milliseconds(5);
  client_options.max_backoff = std::chrono::milliseconds(100);
  client_options.retry_for = std::chrono::minutes(2);
  client_ = MapClient::Create(client_options).value();
  session_ = client_
                 ->OpenSession(options.map, fmt::format("device{}", options.number), SensorKind::kRgbd,
                               testing::SyntheticWorld::DeviceCamera(), {}, /*create_map=*/true)
                 .value()
                 .id;
  thread_ = std::jthread([this](const std::stop_token& stop) { Run(stop); });
}

Uploader::~Uploader() {
  if (!thread_.joinable()) return;
  // The test has failed: do not wait for a server that may have gone.
  thread_.request_stop();
  client_->Cancel();
  allowed_.release();
}

void Uploader::Stop() {
  thread_.request_stop();
  allowed_.release();
  thread_.join();
  const auto closed = client_->CloseSession(session_);
  EXPECT_TRUE(closed.ok()) << closed.status();
  num_retries_ = client_->traffic().num_retries;
  client_.reset();  // a server that stops waits for connections that nobody serves
}

void Uploader::Run(const std::stop_token& stop) {
  const testing::SyntheticWorld world(1);
  const Pose3 begin = testing::SyntheticWorld::Stand(0, -2, 0);
  Rng rng(session_.value());
  for (uint32_t number = 0;; ++number) {
    if (options_.waits) allowed_.acquire();
    if (stop.stop_requested()) return;
    const Pose3 T_world_camera = testing::SyntheticWorld::Stand(0.01 * number, -2, 0);
    Keyframe keyframe = world.View(T_world_camera, session_, number, rng);
    std::erase_if(keyframe.features, [&](const KeyframeFeature& feature) {
      return feature.point->id % static_cast<uint64_t>(options_.keep_every) != 0;
    });
    keyframe.pose_frame = PoseFrame::kSession;
    keyframe.T_frame_camera = begin.Inverse() * T_world_camera;
    keyframe.stamp_ns = int64_t{number} * 1'000'000'000;
    const auto uploaded = client_->UploadKeyframe(EncodeKeyframe(keyframe));
    ASSERT_TRUE(uploaded.ok()) << uploaded.status();
    num_acknowledged_ = number + 1;
    if (options_.acknowledged != nullptr) options_.acknowledged->release();
  }
}

void ExpectKeyframes(MapReader& reader, const AcknowledgedKeyframes& acknowledged) {
  const SessionId session = acknowledged.session;
  const auto record = reader.GetSession(session);
  ASSERT_TRUE(record.ok()) << record.status();
  const auto frames = reader.ListFrames(record->map, session).value();
  EXPECT_GE(frames.size(), acknowledged.count) << "of session " << session.value();
  EXPECT_EQ(record->num_keyframes, static_cast<int64_t>(frames.size()));
  std::vector<int> num_stored(frames.size(), 0);
  for (const FrameRecord& frame : frames) {
    ASSERT_LT(frame.number, frames.size()) << "a device uploads one after the other";
    ++num_stored[frame.number];
    EXPECT_TRUE(DecodeKeyframe(reader.GetPacket(frame.id).value()).ok());
  }
  EXPECT_THAT(num_stored, ::testing::Each(1)) << "of session " << session.value();
}

}  // namespace mapp
