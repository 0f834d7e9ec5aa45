#include "client_sdk/src/alignment_in_use.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

Pose3 AtX(double x) { return Pose3(Eigen::Quaterniond::Identity(), {x, 0, 0}); }

double XOf(const std::optional<Sim3>& alignment) { return alignment.value().pose.translation().x(); }

TrackingResult OwnFrame(uint32_t fragment = 0) {
  TrackingResult frame;
  frame.fragment = fragment;
  return frame;
}
TrackingResult SharedFrame(double map_x) {
  TrackingResult frame;
  frame.on_shared_map = true;
  frame.T_map_session = AtX(map_x);
  return frame;
}

TEST(AlignmentInUseTest, OnTheOwnMapItIsTheServers) {
  AlignmentInUse alignment;
  EXPECT_FALSE(alignment.For(OwnFrame(), std::nullopt).has_value());
  EXPECT_EQ(XOf(alignment.For(OwnFrame(), Sim3{2, AtX(1)})), 1);
  EXPECT_EQ(alignment.For(OwnFrame(), Sim3{2, AtX(1)})->scale, 2);
}

TEST(AlignmentInUseTest, ASharedMapsPointsArePlacedByTheOneItCameWith) {
  AlignmentInUse alignment;
  EXPECT_EQ(XOf(alignment.For(SharedFrame(1), Sim3{1, AtX(1.3)})), 1) << "corrected since";
}

TEST(AlignmentInUseTest, LeavingTheSharedMapIsNoStepThoughTheServerCorrectedMeanwhile) {
  AlignmentInUse alignment;
  alignment.For(SharedFrame(1), Sim3{1, AtX(1)});
  alignment.For(SharedFrame(1), Sim3{1, AtX(1.3)});
  EXPECT_EQ(XOf(alignment.For(OwnFrame(), Sim3{1, AtX(1.3)})), 1);
  EXPECT_EQ(XOf(alignment.For(OwnFrame(), Sim3{1, AtX(1.3)})), 1);
}

TEST(AlignmentInUseTest, ACorrectionAfterwardsCounts) {
  AlignmentInUse alignment;
  alignment.For(SharedFrame(1), Sim3{1, AtX(1.3)});
  EXPECT_EQ(XOf(alignment.For(OwnFrame(), Sim3{1, AtX(2)})), 2);
  EXPECT_EQ(XOf(alignment.For(OwnFrame(), Sim3{1, AtX(1.3)})), 1.3) << "what was before the correction is over";
  EXPECT_EQ(XOf(alignment.For(SharedFrame(4), Sim3{1, AtX(2)})), 4);
}

TEST(AlignmentInUseTest, AnotherFragmentHasAnother) {
  AlignmentInUse alignment;
  alignment.For(SharedFrame(1), Sim3{1, AtX(1)});
  EXPECT_FALSE(alignment.For(OwnFrame(1), std::nullopt).has_value());
  EXPECT_EQ(XOf(alignment.For(OwnFrame(1), Sim3{1, AtX(1)})), 1);
}

}  // namespace
}  // namespace mapp
