#include "client_sdk/src/redundancy_control.h"

#include "synthetic_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace mapp {
namespace {

using testing::SizeIs;

constexpr int kNumPoints = 100;

std::set<uint64_t> PointIds(const Keyframe& keyframe) {
  std::set<uint64_t> ids;
  for (const KeyframeFeature& feature : keyframe.features) ids.insert(feature.point->id);
  return ids;
}

class RedundancyControlTest : public testing::Test {
 protected:
  const Keyframe whole_ = TestKeyframe(0, Pose3(), kNumPoints);
  const OwnPoints own_ = OwnPointsOf(whole_, TestCamera());
  std::vector<bool> redundant_ = std::vector<bool>(kNumPoints, false);
  Rng rng_{1};
};

TEST_F(RedundancyControlTest, OwnPointsLieOnTheRaysOfTheirFeatures) {
  ASSERT_THAT(own_.p_camera, SizeIs(kNumPoints));
  for (size_t i = 0; i < own_.p_camera.size(); ++i) {
    const KeyframeFeature& feature = whole_.features[own_.feature_idx[i]];
    EXPECT_NEAR(own_.p_camera[i].z(), feature.point->depth_m, 1e-6);
    const Eigen::Vector2d pixel = TestCamera().Project(own_.p_camera[i]);
    EXPECT_NEAR(pixel.x(), feature.keypoint.u_px, 1e-3);
  }
}

TEST_F(RedundancyControlTest, FreshPointsStayAndFeaturesWithoutAPointGo) {
  const Reduced reduced = RemoveRedundant(whole_, own_, redundant_, Injection::kNone, rng_);
  EXPECT_TRUE(reduced.keyframe.partial);
  EXPECT_EQ(reduced.num_fresh, size_t{kNumPoints});
  EXPECT_THAT(reduced.keyframe.features, SizeIs(kNumPoints));
  EXPECT_EQ(reduced.keyframe.number, whole_.number);
  EXPECT_EQ(reduced.keyframe.stamp_ns, whole_.stamp_ns);
}

TEST_F(RedundancyControlTest, RedundantPointsGoWithTheirFeatures) {
  for (int i = 0; i < 30; ++i) redundant_[i] = true;
  const Reduced reduced = RemoveRedundant(whole_, own_, redundant_, Injection::kNone, rng_);
  EXPECT_EQ(reduced.num_fresh, 70U);
  const std::set<uint64_t> ids = PointIds(reduced.keyframe);
  for (int i = 0; i < kNumPoints; ++i) {
    EXPECT_EQ(ids.contains(whole_.features[own_.feature_idx[i]].point->id), i >= 30) << i;
  }
}

TEST_F(RedundancyControlTest, InjectionKeepsWhatWasObservedMoreOftenThanAverage) {
  redundant_.assign(kNumPoints, true);
  const Reduced reduced = RemoveRedundant(whole_, own_, redundant_, Injection::kOften, rng_);
  EXPECT_EQ(reduced.num_fresh, 0U);
  // Observation counts are 1 to 5 in turn: the mean is 3, and two in five are above it.
  ASSERT_THAT(reduced.keyframe.features, SizeIs(40));
  for (const KeyframeFeature& feature : reduced.keyframe.features) EXPECT_GT(feature.point->num_observations, 3);
}

TEST_F(RedundancyControlTest, RandomInjectionKeepsAsManyOfTheRedundantOnes) {
  for (int i = 0; i < 50; ++i) redundant_[i] = true;
  const Reduced often = RemoveRedundant(whole_, own_, redundant_, Injection::kOften, rng_);
  const Reduced random = RemoveRedundant(whole_, own_, redundant_, Injection::kRandom, rng_);
  EXPECT_EQ(random.keyframe.features.size(), often.keyframe.features.size());
  EXPECT_EQ(PointIds(random.keyframe).size(), random.keyframe.features.size()) << "none is chosen twice";
  EXPECT_NE(PointIds(random.keyframe), PointIds(often.keyframe));
}

TEST_F(RedundancyControlTest, AKeyframeWithoutPointsHasNothingToSend) {
  Keyframe bare = whole_;
  for (KeyframeFeature& feature : bare.features) feature.point.reset();
  const OwnPoints none = OwnPointsOf(bare, TestCamera());
  const Reduced reduced = RemoveRedundant(bare, none, {}, Injection::kOften, rng_);
  EXPECT_EQ(reduced.num_fresh, 0U);
  EXPECT_THAT(reduced.keyframe.features, SizeIs(0));
}

}  // namespace
}  // namespace mapp
