#include "cli/visit_spec.h"

#include "eval/harness/visit_name.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

TEST(ParseVisitSpecTest, ReadsEveryKey) {
  const auto spec = ParseVisitSpec(
      "sim:garage:users=5,path=62.5,seed=3,camera=d455-640+euroc,sensor=stereo,rate=15,changes=4,passers=2,"
      "changes-near=6.5,change-kinds=vanished+moved,stable=3,"
      "trajectory=a/b.txt+c.txt,textures=x/y,routes=2,max-duration=9,noise=0.5,exposure=1.5,motion-blur=3,"
      "exposure-ms=8/4");
  ASSERT_TRUE(spec.ok()) << spec.status();
  const sim::SimulationOptions& simulation = spec->simulation;
  EXPECT_EQ(simulation.setting, "garage");
  EXPECT_EQ(simulation.num_users, 5);
  EXPECT_DOUBLE_EQ(simulation.path_m, 62.5);
  EXPECT_EQ(simulation.seed, 3U);
  EXPECT_THAT(simulation.cameras, testing::ElementsAre("d455-640", "euroc"));
  EXPECT_EQ(simulation.sensor, SensorKind::kStereo);
  EXPECT_DOUBLE_EQ(simulation.rate_hz, 15);
  EXPECT_EQ(simulation.num_changes, 4);
  EXPECT_EQ(simulation.num_passers, 2);
  EXPECT_DOUBLE_EQ(simulation.change_reach_m, 6.5);
  EXPECT_THAT(simulation.change_kinds, testing::ElementsAre(sim::ChangeKind::kVanished, sim::ChangeKind::kMoved));
  EXPECT_EQ(simulation.num_stable_visits, 3);
  EXPECT_THAT(simulation.trajectory_files, testing::ElementsAre("a/b.txt", "c.txt"));
  EXPECT_EQ(simulation.textures_folder, "x/y");
  EXPECT_EQ(simulation.num_routes, 2);
  EXPECT_DOUBLE_EQ(simulation.max_duration_s, 9);
  EXPECT_DOUBLE_EQ(spec->images.noise.gray_sigma, sim::ImageOptions().noise.gray_sigma / 2);
  EXPECT_DOUBLE_EQ(spec->images.exposure, 1.5);
  EXPECT_EQ(spec->images.motion_blur, 3);
  EXPECT_DOUBLE_EQ(spec->images.exposure_s.value(), 0.008);
  EXPECT_EQ(spec->user, 4);
}

TEST(ParseVisitSpecTest, ReadsTheNamesThatTheEvaluationGives) {
  sim::SimulationOptions options;
  options.setting = "plaza";
  options.num_users = 5;
  options.path_m = 62.5;
  options.seed = 3;
  options.cameras = {"d455-640", "euroc"};
  options.sensor = SensorKind::kMonoInertial;
  options.rate_hz = 12.5;
  options.num_changes = 4;
  options.num_passers = 2;
  options.change_reach_m = 6.5;
  options.change_kinds = {sim::ChangeKind::kAppeared, sim::ChangeKind::kMoved};
  options.num_stable_visits = 3;
  options.textures_folder = "x/y";
  options.trajectory_files = {"a/b.txt", "c.txt"};
  options.num_routes = 2;
  options.max_duration_s = 9.5;
  const auto spec = ParseVisitSpec(VisitName(options, 4));
  ASSERT_TRUE(spec.ok()) << spec.status();
  EXPECT_EQ(VisitName(spec->simulation, spec->user), VisitName(options, 4));
  EXPECT_EQ(spec->simulation.sensor, SensorKind::kMonoInertial);
  EXPECT_EQ(spec->simulation.trajectory_files, options.trajectory_files);
  EXPECT_EQ(spec->simulation.change_kinds, options.change_kinds);
}

TEST(ParseVisitSpecTest, MakesAsManyUsersAsAreNeeded) {
  EXPECT_EQ(ParseVisitSpec("sim:hall/0")->simulation.num_users, 1);
  EXPECT_EQ(ParseVisitSpec("sim:hall:seed=2/7")->simulation.num_users, 8);
}

struct BadSpec {
  const char* text;
  const char* problem;
};

class BadVisitSpecTest : public testing::TestWithParam<BadSpec> {};

TEST_P(BadVisitSpecTest, SaysWhatIsWrong) {
  const Status status = ParseVisitSpec(GetParam().text).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(testing::StartsWith(GetParam().text), testing::HasSubstr(GetParam().problem)));
}

INSTANTIATE_TEST_SUITE_P(
    Specs, BadVisitSpecTest,
    testing::Values(BadSpec{"sim:cellar/0", "'cellar' is none of room, garage"},
                    BadSpec{"sim:garage", "sim:SETTING/USER"}, BadSpec{"sim:garage/", "no user's number"},
                    BadSpec{"sim:garage/-1", "no user's number"}, BadSpec{"sim:garage:users=2/2", "user 2 of 2"},
                    BadSpec{"sim:garage:/0", "KEY=VALUE"},
                    BadSpec{"sim:garage:colour=1/0", "'colour' is none of users"},
                    BadSpec{"sim:garage:users=x/0", "users: a number expected, got 'x'"},
                    BadSpec{"sim:garage:path=60m/0", "path: a number expected, got '60m'"},
                    BadSpec{"sim:garage:seed=1,seed=2/0", "seed: given twice"},
                    BadSpec{"sim:garage:sensor=lidar/0", "lidar is not one of rgbd"},
                    BadSpec{"sim:garage:camera=d435/0", "camera: "}, BadSpec{"sim:garage:changes=3/0", "users=N"},
                    BadSpec{"sim:garage:change-kinds=moved+melted/0", "change-kinds: melted is not one of appeared"},
                    BadSpec{"sim:garage:changes-near=x/0", "changes-near: a number expected"},
                    BadSpec{"sim:garage:stable=x/0", "stable: a number expected"}));

}  // namespace
}  // namespace mapp
