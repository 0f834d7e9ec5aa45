#include "mapp/codec/query_codec.h"

#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mapp {
namespace {

using ::testing::StartsWith;

constexpr double kRotationLoss = 1e-4;  // radians: three components of 16 bits
constexpr double kPositionLoss = 1e-5;  // float at some tens of metres

ViewQuery RandomQuery(Rng& rng) {
  ViewQuery query;
  query.pose_frame = rng.Below(2) == 0 ? PoseFrame::kSession : PoseFrame::kMap;
  const Eigen::Quaterniond rotation(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal());
  query.T_frame_camera = Pose3(rotation, {rng.Uniform(-50, 50), rng.Uniform(-50, 50), rng.Uniform(-50, 50)});
  query.sampler = static_cast<SamplerKind>(1 + rng.Below(3));
  if (query.sampler == SamplerKind::kUniform) return query;
  for (DepthSketch::Cell& cell : query.sketch.cells) {
    if (rng.Below(4) == 0) continue;
    cell.near_code = static_cast<uint8_t>(1 + rng.Below(255));
    cell.far_code = static_cast<uint8_t>(cell.near_code + rng.Below(256U - cell.near_code));
  }
  return query;
}

TEST(ViewQueryTest, RoundTripsWithin43Bytes) {
  Rng rng(1);
  for (int i = 0; i < 500; ++i) {
    const ViewQuery sent = RandomQuery(rng);
    const std::string bytes = EncodeViewQuery(sent);
    EXPECT_LE(bytes.size(), 43U);
    const StatusOr<ViewQuery> got = DecodeViewQuery(bytes);
    ASSERT_TRUE(got.ok()) << got.status();
    EXPECT_EQ(got->pose_frame, sent.pose_frame);
    EXPECT_EQ(got->sampler, sent.sampler);
    EXPECT_EQ(got->sketch, sent.sketch);
    EXPECT_LT(Distance(got->T_frame_camera, sent.T_frame_camera), kPositionLoss);
    EXPECT_LT(RotationAngle(got->T_frame_camera, sent.T_frame_camera), kRotationLoss);
  }
}

TEST(ViewQueryTest, RefusesMalformedBytes) {
  Rng rng(2);
  ViewQuery query = RandomQuery(rng);
  query.sampler = SamplerKind::kDepthSketch;
  const std::string good = EncodeViewQuery(query);
  const auto message = [](const std::string& bytes) {
    const Status status = DecodeViewQuery(bytes).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_THAT(message(""), StartsWith("view: "));
  EXPECT_THAT(message(good.substr(0, 20)), StartsWith("view: "));
  EXPECT_THAT(message(good + "x"), StartsWith("view: "));
  std::string unknown = good;
  unknown[0] = static_cast<char>(0xff);
  EXPECT_THAT(message(unknown), StartsWith("view: "));
  std::string no_sampler = good;
  no_sampler[0] = static_cast<char>(good[0] & ~6);
  EXPECT_THAT(message(no_sampler), StartsWith("view: "));
  std::string not_finite = good;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(not_finite.data() + 1, &nan, sizeof(nan));
  EXPECT_THAT(message(not_finite), StartsWith("view.pose: "));
  std::string not_unit = good;
  for (size_t i = 13; i < 19; i += 2) {
    not_unit[i] = '\xff';
    not_unit[i + 1] = '\x7f';
  }
  EXPECT_THAT(message(not_unit), StartsWith("view.pose: "));
  std::string inverted = good;
  inverted[19] = 9;
  inverted[20] = 3;
  EXPECT_THAT(message(inverted), StartsWith("view.sketch[0]: "));
}

TEST(SampleStatesTest, RoundTripsAtEveryShareWithin129Bytes) {
  Rng rng(3);
  for (const size_t size : {0U, 1U, 7U, 8U, 500U, 1000U}) {
    for (const double share : {0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0}) {
      std::vector<bool> states(size);
      for (size_t i = 0; i < size; ++i) states[i] = rng.Uniform() < share;
      const std::string bytes = EncodeSampleStates(states);
      EXPECT_LE(bytes.size(), size / 8 + 4);
      const StatusOr<std::vector<bool>> got = DecodeSampleStates(bytes, size);
      ASSERT_TRUE(got.ok()) << got.status();
      EXPECT_EQ(*got, states) << size << " samples, share " << share;
    }
  }
}

TEST(SampleStatesTest, RareStatesCostFewBytes) {
  std::vector<bool> states(1000, true);
  states[17] = false;
  EXPECT_LE(EncodeSampleStates(states).size(), 3U);
}

TEST(SampleStatesTest, RefusesBytesOfAnotherLength) {
  std::vector<bool> states(1000);
  for (size_t i = 0; i < states.size(); ++i) states[i] = i % 2 == 0;
  const std::string bytes = EncodeSampleStates(states);
  EXPECT_FALSE(DecodeSampleStates(bytes, 800).ok());
  EXPECT_FALSE(DecodeSampleStates("", 1000).ok());
  EXPECT_FALSE(DecodeSampleStates(std::string("\x01\xff\x7f"), 1000).ok());
  EXPECT_FALSE(DecodeSampleStates(std::string("\x01\x05\x00", 3), 1000).ok());
  EXPECT_FALSE(DecodeSampleStates("\xf0", 1000).ok());
}

}  // namespace
}  // namespace mapp
