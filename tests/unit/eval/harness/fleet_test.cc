#include "eval/harness/fleet.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace mapp {
namespace {

using testing::ElementsAre;

TEST(FleetTest, PoliciesBecomeOptionsOfReplay) {
  EXPECT_THAT(ReplayArguments(PolicyNamed("upload_all").participation), ElementsAre("--policy", "upload_all"));
  EXPECT_THAT(ReplayArguments(PolicyNamed("no_sharing").participation),
              ElementsAre("--policy", "map", "--sampler", "depth_sketch", "--injection", "often", "--sharing", "off",
                          "--alpha", "1.3", "--look-ahead", fmt::format("{}", ParticipantOptions().look_ahead_m)));
  EXPECT_THAT(ReplayArguments(PolicyNamed("random_injection").participation),
              testing::IsSupersetOf({"--injection", "random"}));
}

TEST(FleetTest, WhatDiffersHasAnotherKey) {
  const FleetSpec spec = FleetOf({}, Level::kFeatures, "upload_all");
  EXPECT_EQ(spec.Key(), FleetOf({}, Level::kFeatures, "upload_all").Key());
  EXPECT_NE(spec.Key(), FleetOf({}, Level::kRendered, "upload_all").Key());
  EXPECT_NE(spec.Key(), FleetOf({}, Level::kFeatures, "uniform").Key());
  for (const auto& change : std::vector<std::function<void(FleetSpec&)>>{
           [](FleetSpec& s) { s.concurrent = true; }, [](FleetSpec& s) { s.reconstruct = true; },
           [](FleetSpec& s) { s.world.seed = 5; }, [](FleetSpec& s) { s.world.num_routes = 1; },
           [](FleetSpec& s) { s.world.max_duration_s = 3; }, [](FleetSpec& s) { s.world.path_m = 61; },
           [](FleetSpec& s) { s.devices[0].tile_cache = "one"; }, [](FleetSpec& s) { s.world.cameras = {"euroc"}; },
           [](FleetSpec& s) { s.world.change_reach_m = 6; }, [](FleetSpec& s) { s.world.num_stable_visits = 1; },
           [](FleetSpec& s) { s.world.change_kinds = {sim::ChangeKind::kMoved}; },
           [](FleetSpec& s) { s.devices.pop_back(); }}) {
    FleetSpec other = spec;
    change(other);
    EXPECT_NE(other.Key(), spec.Key());
  }
}

TEST(FleetTest, FiguresAreCollectedFromThoseWhoHaveThem) {
  FleetFigures fleet;
  fleet.devices.resize(3);
  fleet.devices[0].report.Set("ate_m", 1);
  fleet.devices[2].report.Set("ate_m", 4);
  EXPECT_THAT(Collect(fleet, "ate_m"), ElementsAre(1, 4));
  EXPECT_EQ(SumOf(fleet, "ate_m"), 5);
  EXPECT_EQ(MeanOf(fleet, "ate_m"), 2.5);
  EXPECT_EQ(MeanOf(fleet, "other"), std::nullopt);
}

}  // namespace
}  // namespace mapp
