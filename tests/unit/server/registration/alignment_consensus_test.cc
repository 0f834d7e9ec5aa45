#include "server/service/alignment_consensus.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace mapp {
namespace {

const Pose3 kTruth(Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(0.2, 1, 0.1).normalized())), {1, -2, 3});

Pose3 SessionPose(uint32_t number) {
  return Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(0.1 * number, Eigen::Vector3d::UnitY())), {0.3 * number, 0, 0});
}

/// A keyframe that puts its session at `T_map_session`.
KeyframeAlignment Saying(uint32_t number, const Pose3& T_map_session, size_t num_inliers = 50) {
  KeyframeAlignment alignment;
  alignment.number = number;
  alignment.T_session_camera = SessionPose(number);
  alignment.match.T_map_camera = T_map_session * alignment.T_session_camera;
  alignment.match.information = 1e4 * Eigen::Matrix<double, 6, 6>::Identity();
  alignment.match.inliers.resize(num_inliers);
  return alignment;
}

Pose3 Shifted(double x_m) { return Pose3(Eigen::Quaterniond::Identity(), {x_m, 0, 0}) * kTruth; }

TEST(AlignmentConsensusTest, AcceptsThreeThatAgree) {
  AlignmentConsensus consensus{RegistrarOptions()};
  EXPECT_EQ(consensus.Add(Saying(0, Shifted(0.01))), 1);
  EXPECT_FALSE(consensus.Decide());
  EXPECT_EQ(consensus.Add(Saying(1, Shifted(-0.01))), 2);
  EXPECT_FALSE(consensus.Decide());
  EXPECT_EQ(consensus.Add(Saying(2, kTruth)), 3);
  const auto S_map_session = consensus.Decide();
  ASSERT_TRUE(S_map_session);
  EXPECT_EQ(S_map_session->scale, 1);
  EXPECT_LT(Distance(S_map_session->pose, kTruth), 0.005);
}

TEST(AlignmentConsensusTest, TwoWithMuchSupportSuffice) {
  AlignmentConsensus consensus{RegistrarOptions()};
  consensus.Add(Saying(0, kTruth, 150));
  EXPECT_FALSE(consensus.Decide());
  consensus.Add(Saying(1, kTruth, 150));
  EXPECT_TRUE(consensus.Decide());
}

TEST(AlignmentConsensusTest, TheSameViewCountsOnce) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (uint32_t number = 0; number < 5; ++number) {
    KeyframeAlignment alignment = Saying(0, kTruth, 150);
    alignment.number = number;
    consensus.Add(std::move(alignment));
  }
  EXPECT_FALSE(consensus.Decide());
}

TEST(AlignmentConsensusTest, TheSameKeyframeTwiceIsOneWord) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (int i = 0; i < 4; ++i) EXPECT_EQ(consensus.Add(Saying(3, kTruth, 150)), 1);
  EXPECT_FALSE(consensus.Decide());
}

TEST(AlignmentConsensusTest, RefusesWhenAsManyDisagree) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (uint32_t number = 0; number < 3; ++number) consensus.Add(Saying(number, kTruth));
  for (uint32_t number = 3; number < 6; ++number) consensus.Add(Saying(number, Shifted(4)));
  EXPECT_FALSE(consensus.Decide());
  consensus.Add(Saying(6, kTruth));
  const auto S_map_session = consensus.Decide();
  ASSERT_TRUE(S_map_session);
  EXPECT_EQ(S_map_session->scale, 1);
  EXPECT_LT(Distance(S_map_session->pose, kTruth), 1e-6);
}

TEST(AlignmentConsensusTest, WhatWasForgottenDoesNotOutvote) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (uint32_t number = 0; number < 9; ++number) consensus.Add(Saying(number, Shifted(4)));
  consensus.Forget();
  EXPECT_FALSE(consensus.Decide());
  for (uint32_t number = 9; number < 12; ++number) consensus.Add(Saying(number, kTruth));
  const auto S_map_session = consensus.Decide();
  ASSERT_TRUE(S_map_session);
  EXPECT_EQ(S_map_session->scale, 1);
  EXPECT_LT(Distance(S_map_session->pose, kTruth), 1e-6);
}

TEST(AlignmentConsensusTest, ScatteredWordsNeverAgree) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (uint32_t number = 0; number < 20; ++number) {
    EXPECT_EQ(consensus.Add(Saying(number, Shifted(0.5 * number), 150)), 1);
    EXPECT_FALSE(consensus.Decide());
  }
}

/// The same of a session whose unit is `scale` metres, as a keyframe of `told` would have it.
KeyframeAlignment SayingInUnits(uint32_t number, double scale, double told) {
  KeyframeAlignment alignment = Saying(number, kTruth);
  const Pose3& metric = alignment.T_session_camera;
  alignment.T_session_camera = Pose3(metric.rotation(), metric.translation() / scale);
  alignment.match.scale = told;
  return alignment;
}

TEST(AlignmentConsensusTest, KeyframesInUnitsOfTheirOwnAgreeOnASimilarity) {
  AlignmentConsensus consensus{RegistrarOptions()};
  EXPECT_EQ(consensus.Add(SayingInUnits(0, 2.5, 2.3)), 1);
  EXPECT_EQ(consensus.Add(SayingInUnits(1, 2.5, 2.35)), 2);
  EXPECT_EQ(consensus.Add(SayingInUnits(2, 2.5, 2.3)), 3);
  EXPECT_FALSE(consensus.Decide()) << "depths alone do not tell the scale well enough";
  for (const uint32_t number : {3U, 4U, 5U}) consensus.Add(SayingInUnits(number, 2.5, 2.3));
  const auto S_map_session = consensus.Decide();
  ASSERT_TRUE(S_map_session);
  // Way between the keyframes tells the scale better than their depths do.
  EXPECT_NEAR(S_map_session->scale, 2.5, 0.05);
  for (const uint32_t number : {0U, 1U, 2U}) {
    const Pose3 T_map_camera = *S_map_session * SayingInUnits(number, 2.5, 2.5).T_session_camera;
    EXPECT_LT(Distance(T_map_camera, kTruth * SessionPose(number)), 0.03) << number;
  }
}

TEST(AlignmentConsensusTest, KeyframesOfDifferentScalesDoNotAgree) {
  AlignmentConsensus consensus{RegistrarOptions()};
  for (uint32_t number = 0; number < 6; ++number) {
    EXPECT_EQ(consensus.Add(SayingInUnits(number, 2.5, 2.5 * std::pow(1.5, number))), 1);
    EXPECT_FALSE(consensus.Decide());
  }
}

TEST(FuseAlignmentsTest, WellConstrainedKeyframesWeighMore) {
  const Eigen::Matrix<double, 6, 6> weak = 100.0 * Eigen::Matrix<double, 6, 6>::Identity();
  KeyframeAlignment precise = Saying(0, kTruth);
  precise.match.information *= 1e3;
  KeyframeAlignment vague = Saying(1, Shifted(0.1));
  vague.match.information = weak;
  const KeyframeAlignment* const both[] = {&vague, &precise};
  EXPECT_LT(Distance(FuseAlignments(both).S_map_session.pose, kTruth), 0.02);
}

TEST(FuseAlignmentsTest, AveragesNoise) {
  Rng rng(5);
  std::vector<KeyframeAlignment> alignments;
  for (uint32_t number = 0; number < 40; ++number) {
    KeyframeAlignment alignment = Saying(number, kTruth);
    Eigen::Matrix<double, 6, 1> noise;
    for (int i = 0; i < 6; ++i) noise[i] = (i < 3 ? 0.02 : 0.005) * rng.Normal();
    alignment.match.T_map_camera = alignment.match.T_map_camera * Pose3::Exp(noise);
    alignments.push_back(alignment);
  }
  std::vector<const KeyframeAlignment*> pointers;
  for (const KeyframeAlignment& alignment : alignments) pointers.push_back(&alignment);
  const Pose3 fused = FuseAlignments(pointers).S_map_session.pose;
  // Judged in the middle of the session, where its keyframes are: 0.02 m and 5 mrad over sqrt(40), three sigma.
  EXPECT_LT(Distance(fused * SessionPose(20), kTruth * SessionPose(20)), 0.02);
  EXPECT_LT(RotationAngle(fused, kTruth), 0.005);
}

}  // namespace
}  // namespace mapp
