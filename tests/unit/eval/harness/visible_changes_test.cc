#include "eval/harness/visible_changes.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

class SortChangesTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    sim::SimulationOptions options;
    options.setting = "garage";
    options.num_users = 2;
    options.num_routes = 1;
    options.path_m = 20;
    options.rate_hz = 5;
    options.num_changes = 3;
    options.change_reach_m = 8;
    options.change_kinds = {sim::ChangeKind::kVanished};
    simulation_ = sim::Simulate(options).value();
    world_ = std::make_shared<const sim::FeatureWorld>(simulation_->world);
  }
  static void TearDownTestSuite() {
    world_ = nullptr;
    simulation_ = nullptr;
  }

  static SortedChanges Sort(std::span<const sim::Visit> visits) { return SortChanges(world_, visits).value(); }

  static inline std::shared_ptr<const sim::Simulation> simulation_;
  static inline std::shared_ptr<const sim::FeatureWorld> world_;
};

TEST_F(SortChangesTest, WhatStoodBesideTheWayIsVisible) {
  const SortedChanges sorted = Sort(simulation_->visits);
  EXPECT_EQ(sorted.visible.size() + sorted.others.size(), 3U);
  EXPECT_GE(sorted.visible.size(), 1U);
}

TEST_F(SortChangesTest, NothingIsVisibleThatNobodySawAfterwardsOrBefore) {
  EXPECT_EQ(Sort({simulation_->visits.data(), 1}).others.size(), 3U);
  EXPECT_EQ(Sort({simulation_->visits.data() + 1, 1}).others.size(), 3U);
}

TEST_F(SortChangesTest, NothingIsVisibleFromElsewhere) {
  std::vector<sim::Visit> visits = simulation_->visits;
  for (StampedPose& pose : visits.back().poses) {
    pose.T_world_camera =
        Pose3(pose.T_world_camera.rotation(), pose.T_world_camera.translation() + Eigen::Vector3d(0, 0, 100));
  }
  EXPECT_TRUE(Sort(visits).visible.empty());
}

}  // namespace
}  // namespace mapp
