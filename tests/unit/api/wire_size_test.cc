// The sizes that the wire contract promises, as serialised.

#include "mapp/base/rng.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "mapp/v1/map_service.pb.h"

#include <gtest/gtest.h>

#include <limits>

namespace mapp {
namespace {

constexpr size_t kMaxQueryBytes = 64;
constexpr size_t kMaxResponseBytes = 200;
constexpr size_t kMaxUploadBytes = 45'000;
constexpr uint32_t kNumSamples = 1000;

TEST(WireSizeTest, QueryWithTheLargestIdsFits64Bytes) {
  ViewQuery view;
  view.pose_frame = PoseFrame::kMap;
  view.T_frame_camera = Pose3(Eigen::Quaterniond(0.1, -0.7, 0.7, 0.1), {-1e6, 1e6, 123456.789});
  for (DepthSketch::Cell& cell : view.sketch.cells) cell = {.near_code = 200, .far_code = 255};
  v1::AssessOverlapRequest request;
  request.set_session_id(std::numeric_limits<uint32_t>::max());
  request.set_keyframe(std::numeric_limits<uint32_t>::max());
  request.set_num_samples(kNumSamples);
  for (const SamplerKind sampler : {SamplerKind::kUniform, SamplerKind::kDepthSketch, SamplerKind::kOccupancy}) {
    view.sampler = sampler;
    request.set_view(EncodeViewQuery(view));
    EXPECT_LE(request.SerializeAsString().size(), kMaxQueryBytes);
  }
}

TEST(WireSizeTest, ResponseToAThousandSamplesFits200Bytes) {
  // Evenly mixed classes are the worst case: no shorter form than the mask exists.
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    Rng rng(seed);
    std::vector<bool> redundant(kNumSamples);
    for (size_t i = 0; i < redundant.size(); ++i) redundant[i] = rng.Below(20) < seed;
    v1::AssessOverlapResponse response;
    response.set_answer(EncodeOverlapAnswer(SampleStates{redundant}));
    response.set_map_revision(std::numeric_limits<uint64_t>::max());
    EXPECT_LE(response.SerializeAsString().size(), kMaxResponseBytes) << "seed " << seed;
  }
}

TEST(WireSizeTest, WholeKeyframeOfAThousandPointsFits45KB) {
  Rng rng(1);
  Keyframe keyframe;
  keyframe.session = SessionId(std::numeric_limits<uint32_t>::max());
  keyframe.number = std::numeric_limits<uint32_t>::max();
  keyframe.stamp_ns = std::numeric_limits<int64_t>::max();
  keyframe.overlap = 0.5F;
  for (int i = 0; i < kMaxFeatures; ++i) {
    KeyframeFeature feature;
    feature.keypoint = {.u_px = static_cast<float>(rng.Uniform(0, 1279)),
                        .v_px = static_cast<float>(rng.Uniform(0, 719)),
                        .angle = static_cast<float>(rng.Uniform(0, 6.28)),
                        .octave = static_cast<uint8_t>(rng.Below(kPyramidLevels))};
    for (uint64_t& word : feature.descriptor.words) word = rng.Next();
    // Numbers as a device of a long session has them.
    feature.point = PointReference{.kind = PointReference::Kind::kSessionPoint,
                                   .id = 100'000 + rng.Below(2'000),
                                   .depth_m = static_cast<float>(rng.Uniform(0.3, 20)),
                                   .num_observations = 9};
    keyframe.features.push_back(feature);
  }
  v1::UploadPartialKeyframeRequest request;
  request.set_keyframe(EncodeKeyframe(keyframe));
  EXPECT_LE(request.SerializeAsString().size(), kMaxUploadBytes);
}

}  // namespace
}  // namespace mapp
