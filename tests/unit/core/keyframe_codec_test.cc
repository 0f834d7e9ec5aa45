#include "mapp/codec/keyframe_codec.h"

#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mapp {
namespace {

using ::testing::HasSubstr;

constexpr size_t kMaxWholeKeyframeBytes = 45 * 1000;  // issue bar: 45 KB for 1000 features

Keyframe RandomKeyframe(uint64_t seed, int num_features) {
  Rng rng(seed);
  Keyframe keyframe;
  keyframe.session = SessionId(rng.Below(UINT32_MAX));
  keyframe.number = static_cast<uint32_t>(rng.Next());
  keyframe.stamp_ns = static_cast<int64_t>(rng.Next());
  keyframe.pose_frame = rng.Below(2) == 0 ? PoseFrame::kSession : PoseFrame::kMap;
  Eigen::Matrix<double, 6, 1> tangent;
  for (int i = 0; i < 6; ++i) tangent[i] = rng.Normal();
  keyframe.T_frame_camera = Pose3::Exp(tangent);
  keyframe.partial = rng.Below(2) == 0;
  if (rng.Below(2) == 0) keyframe.overlap = static_cast<float>(rng.Uniform());
  uint64_t session_point = rng.Below(1 << 20);
  for (int i = 0; i < num_features; ++i) {
    KeyframeFeature feature;
    feature.keypoint = {static_cast<float>(rng.Uniform(-0.5, 639)), static_cast<float>(rng.Uniform(-0.5, 479)),
                        static_cast<float>(rng.Uniform(0, 6.28)), static_cast<uint8_t>(rng.Below(kPyramidLevels))};
    for (uint64_t& word : feature.descriptor.words) word = rng.Next();
    const uint64_t kind = rng.Below(10);
    if (kind < 9) {
      PointReference point;
      point.kind = kind < 7 ? PointReference::Kind::kSessionPoint : PointReference::Kind::kMapPoint;
      point.id = kind < 7 ? (session_point += 1 + rng.Below(50)) : rng.Below(1'000'000);
      point.depth_m = static_cast<float>(std::exp(rng.Uniform(std::log(0.05), std::log(500))));
      point.num_observations = static_cast<uint16_t>(1 + rng.Below(40));
      feature.point = point;
    }
    keyframe.features.push_back(feature);
  }
  return keyframe;
}

TEST(KeyframeCodecTest, RenumberingChangesNothingElse) {
  for (uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE(seed);
    const std::string sent = EncodeKeyframe(RandomKeyframe(seed, static_cast<int>(seed * 37 % 1000)));
    const Keyframe before = *DecodeKeyframe(sent);
    const std::string changed =
        RenumberKeyframe(sent, SessionId(77), [](uint64_t id) { return 3 * id + 1'000'000'000; });
    const StatusOr<Keyframe> after = DecodeKeyframe(changed);
    ASSERT_TRUE(after.ok()) << after.status();
    EXPECT_EQ(after->session, SessionId(77));
    for (size_t i = 0; i < before.features.size(); ++i) {
      const auto& point = before.features[i].point;
      ASSERT_EQ(after->features[i].point.has_value(), point.has_value());
      if (!point) continue;
      const bool in_map = point->kind == PointReference::Kind::kMapPoint;
      EXPECT_EQ(after->features[i].point->id, in_map ? 3 * point->id + 1'000'000'000 : point->id);
    }
    EXPECT_EQ(RenumberKeyframe(changed, before.session, [](uint64_t id) { return (id - 1'000'000'000) / 3; }), sent);
    const auto gone = DecodeKeyframe(RenumberKeyframe(sent, before.session, [](uint64_t) { return 0; }));
    ASSERT_TRUE(gone.ok()) << gone.status();
    EXPECT_EQ(gone->features.size(), before.features.size());
  }
}

TEST(KeyframeCodecTest, RoundTripLosesNoMoreThanDocumented) {
  for (uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE(seed);
    const Keyframe sent = RandomKeyframe(seed, static_cast<int>(seed * 13 % 1000));
    const StatusOr<Keyframe> got = DecodeKeyframe(EncodeKeyframe(sent));
    ASSERT_TRUE(got.ok()) << got.status();
    EXPECT_EQ(got->session, sent.session);
    EXPECT_EQ(got->number, sent.number);
    EXPECT_EQ(got->stamp_ns, sent.stamp_ns);
    EXPECT_EQ(got->pose_frame, sent.pose_frame);
    EXPECT_EQ(got->partial, sent.partial);
    EXPECT_LT((got->T_frame_camera.Matrix() - sent.T_frame_camera.Matrix()).norm(), 1e-12);
    ASSERT_EQ(got->overlap.has_value(), sent.overlap.has_value());
    if (sent.overlap) {
      EXPECT_NEAR(*got->overlap, *sent.overlap, 0.5 / 255 + 1e-6);
    }
    ASSERT_EQ(got->features.size(), sent.features.size());
    for (size_t i = 0; i < sent.features.size(); ++i) {
      const KeyframeFeature& a = sent.features[i];
      const KeyframeFeature& b = got->features[i];
      EXPECT_NEAR(b.keypoint.u_px, a.keypoint.u_px, 1.0 / 32 + 1e-4);
      EXPECT_NEAR(b.keypoint.v_px, a.keypoint.v_px, 1.0 / 32 + 1e-4);
      EXPECT_EQ(b.keypoint.octave, a.keypoint.octave);
      const double turn = std::remainder(b.keypoint.angle - a.keypoint.angle, 2 * M_PI);
      EXPECT_LE(std::abs(turn), M_PI / 256 + 1e-5);
      EXPECT_EQ(b.descriptor, a.descriptor);
      ASSERT_EQ(b.point.has_value(), a.point.has_value());
      if (!a.point) continue;
      EXPECT_EQ(b.point->kind, a.point->kind);
      EXPECT_EQ(b.point->id, a.point->id);
      EXPECT_EQ(b.point->num_observations, a.point->num_observations);
      EXPECT_NEAR(b.point->depth_m / a.point->depth_m, 1.0, 1.1e-4);
    }
  }
}

TEST(KeyframeCodecTest, WholeKeyframeOfAThousandFeaturesFits45KB) {
  Keyframe keyframe = RandomKeyframe(7, kMaxFeatures);
  for (KeyframeFeature& feature : keyframe.features) {
    feature.point = PointReference{.kind = PointReference::Kind::kSessionPoint,
                                   .id = 100'000 + static_cast<uint64_t>(&feature - keyframe.features.data()),
                                   .depth_m = 2.0F,
                                   .num_observations = 3};
  }
  EXPECT_LE(EncodeKeyframe(keyframe).size(), kMaxWholeKeyframeBytes);
}

TEST(KeyframeCodecTest, ObservationCountsSaturate) {
  Keyframe keyframe = RandomKeyframe(8, 1);
  keyframe.features[0].point = PointReference{.id = 1, .depth_m = 1, .num_observations = 1000};
  EXPECT_EQ(DecodeKeyframe(EncodeKeyframe(keyframe))->features[0].point->num_observations, 255);
}

TEST(KeyframeCodecTest, RefusesEveryTruncation) {
  const std::string bytes = EncodeKeyframe(RandomKeyframe(9, 20));
  for (size_t length = 0; length < bytes.size(); ++length) {
    EXPECT_EQ(DecodeKeyframe(bytes.substr(0, length)).status().code(), absl::StatusCode::kInvalidArgument) << length;
  }
}

TEST(KeyframeCodecTest, RefusesEveryFlippedByte) {
  const std::string bytes = EncodeKeyframe(RandomKeyframe(10, 10));
  for (size_t i = 0; i < bytes.size(); ++i) {
    std::string spoiled = bytes;
    spoiled[i] = static_cast<char>(spoiled[i] ^ 0x40);
    EXPECT_FALSE(DecodeKeyframe(spoiled).ok()) << i;
  }
}

/// Rewrites the checksum, as an attacker or a buggy client would have it right.
std::string Resealed(std::string bytes) {
  bytes.resize(bytes.size() - sizeof(uint32_t));
  ByteWriter writer;
  writer.PutBytes(bytes);
  writer.Put<uint32_t>(Crc32c(bytes));
  return writer.Take();
}

TEST(KeyframeCodecTest, SealedGarbageNeverCrashesNorPassesItsLimits) {
  Rng rng(11);
  const std::string bytes = EncodeKeyframe(RandomKeyframe(12, 30));
  for (int trial = 0; trial < 20000; ++trial) {
    std::string spoiled = bytes;
    for (uint64_t flips = 1 + rng.Below(4); flips > 0; --flips) {
      spoiled[5 + rng.Below(spoiled.size() - 9)] = static_cast<char>(rng.Next());
    }
    const StatusOr<Keyframe> decoded = DecodeKeyframe(Resealed(spoiled));
    if (!decoded.ok()) {
      EXPECT_EQ(decoded.status().code(), absl::StatusCode::kInvalidArgument);
      continue;
    }
    EXPECT_LE(decoded->features.size(), static_cast<size_t>(kMaxFeatures));
    EXPECT_TRUE(decoded->T_frame_camera.IsFinite());
  }
}

TEST(KeyframeCodecTest, NamesTheBadField) {
  Keyframe keyframe = RandomKeyframe(13, 1);
  keyframe.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(2e6, 0, 0));
  EXPECT_THAT(std::string(DecodeKeyframe(EncodeKeyframe(keyframe)).status().message()), HasSubstr("keyframe.pose: "));
}

TEST(KeyframeTest, ValidateNamesTheBadField) {
  const Camera camera{.projection = PinholeCamera{.fx = 525, .fy = 525, .cx = 320, .cy = 240},
                      .width_px = 640,
                      .height_px = 480,
                      .stereo_baseline_m = 0};
  const Keyframe good = RandomKeyframe(14, 3);
  ASSERT_TRUE(Validate(good, camera, {}).ok()) << Validate(good, camera, {});
  const auto message = [&](auto spoil) {
    Keyframe bad = good;
    bad.features[2].point = PointReference{.id = 1, .depth_m = 1, .num_observations = 1};
    spoil(bad);
    return std::string(Validate(bad, camera, {}).message());
  };
  EXPECT_THAT(message([](Keyframe& k) { k.features[1].keypoint.u_px = 641; }), HasSubstr("features[1].pixel: "));
  EXPECT_THAT(message([](Keyframe& k) { k.features[0].keypoint.octave = 9; }), HasSubstr("features[0].octave: "));
  EXPECT_THAT(message([](Keyframe& k) { k.features[2].point->depth_m = 0; }), HasSubstr("features[2].depth_m: "));
  EXPECT_THAT(message([](Keyframe& k) { k.features[2].point->depth_m = NAN; }), HasSubstr("features[2].depth_m: "));
  EXPECT_THAT(message([](Keyframe& k) { k.overlap = 1.5F; }), HasSubstr("keyframe.overlap: "));
  EXPECT_THAT(message([](Keyframe& k) { k.features.resize(kMaxFeatures + 1); }), HasSubstr("keyframe.features: "));
}

}  // namespace
}  // namespace mapp
