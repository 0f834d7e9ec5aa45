#include "sim/world/visit_plan.h"

#include "sim/gaze.h"
#include "tests/unit/datasets/temp_folder.h"
#include "tests/unit/sim/world/street_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>

namespace mapp::sim {
namespace {

using testing::HasSubstr;

constexpr int64_t kHourNs = 3'600'000'000'000;

std::vector<Visit> Plan(const SimulationOptions& options) {
  auto visits = PlanVisits(test::StreetWorld(), options);
  EXPECT_TRUE(visits.ok()) << visits.status();
  return std::move(visits).value();
}

SimulationOptions Options(int num_users) {
  SimulationOptions options;
  options.num_users = num_users;
  options.path_m = 80;
  options.seed = 4;
  return options;
}

double DistanceToStreets(const RouteGraph& graph, const Eigen::Vector3d& p_world) {
  double nearest_m = 1e9;
  for (const auto& [a, b] : graph.edges) {
    const Eigen::Vector3d& from = graph.nodes_world[a];
    const Eigen::Vector3d edge = graph.nodes_world[b] - from;
    const double along = std::clamp((p_world - from).dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    nearest_m = std::min(nearest_m, (p_world - from - along * edge).head<2>().norm());
  }
  return nearest_m;
}

TEST(VisitPlanTest, UsersKeepToTheWaysAtAWalkersPace) {
  const World world = test::StreetWorld();
  for (const Visit& visit : Plan(Options(12))) {
    EXPECT_NEAR(visit.path_m, 80, 3) << "bobbing included";
    for (size_t i = 0; i < visit.poses.size(); ++i) {
      ASSERT_LT(DistanceToStreets(world.routes, visit.poses[i].T_world_camera.translation()), world.routes.clearance_m);
      ASSERT_NEAR(visit.poses[i].T_world_camera.translation().z(), 1.5, 0.02);
    }
    const double duration_s = static_cast<double>(visit.poses.back().stamp_ns - visit.poses.front().stamp_ns) * 1e-9;
    EXPECT_GT(80 / duration_s, 0.9);
    EXPECT_LT(80 / duration_s, 1.5);
  }
}

TEST(VisitPlanTest, CamerasLookAheadTurnGentlyAndStartSlowly) {
  for (const Visit& visit : Plan(Options(12))) {
    double cos_sum = 0;
    for (size_t i = 1; i < visit.poses.size(); ++i) {
      const Pose3& before = visit.poses[i - 1].T_world_camera;
      const Pose3& now = visit.poses[i].T_world_camera;
      const double dt = static_cast<double>(visit.poses[i].stamp_ns - visit.poses[i - 1].stamp_ns) * 1e-9;
      const Eigen::Vector3d axis_before = before.rotation() * Eigen::Vector3d::UnitZ();
      const Eigen::Vector3d axis = now.rotation() * Eigen::Vector3d::UnitZ();
      const double yaw = std::atan2(axis_before.x() * axis.y() - axis_before.y() * axis.x(),
                                    axis_before.head<2>().dot(axis.head<2>()));
      ASSERT_LT(std::abs(yaw) / dt, 40 * M_PI / 180) << "frame " << i;
      ASSERT_LT(Distance(before, now) / dt, 1.7) << "frame " << i;
      ASSERT_LT((now.rotation() * Eigen::Vector3d::UnitY()).z(), -0.95) << "held upright";
      cos_sum += axis.dot((now.translation() - before.translation()).normalized());
    }
    EXPECT_GT(cos_sum / static_cast<double>(visit.poses.size()), 0.8);
    EXPECT_LT(Distance(visit.poses[0].T_world_camera, visit.poses[20].T_world_camera), 0.6) << "in the first second";
  }
}

TEST(VisitPlanTest, CurvesAreTakenSlowlyEnoughForAPerson) {
  SimulationOptions options = Options(6);
  options.sensor = SensorKind::kMonoInertial;
  for (const Visit& visit : Plan(options)) {
    ASSERT_FALSE(visit.imu.empty());
    EXPECT_LE(visit.imu.front().stamp_ns, visit.poses.front().stamp_ns);
    EXPECT_GE(visit.imu.back().stamp_ns, visit.poses.back().stamp_ns);
    double worst = 0;
    double mean = 0;
    for (const ImuSample& sample : visit.imu) {
      worst = std::max(worst, std::abs(sample.acceleration_body.norm() - 9.81));
      mean += sample.acceleration_body.norm() / static_cast<double>(visit.imu.size());
    }
    EXPECT_LT(worst, 4.0);
    EXPECT_NEAR(mean, 9.81, 0.3);
  }
}

TEST(VisitPlanTest, VisitsAreHoursApartAndDealtTheSettingsCameras) {
  const auto visits = Plan(Options(4));
  for (size_t k = 0; k < visits.size(); ++k) {
    EXPECT_EQ(visits[k].user, static_cast<int>(k));
    EXPECT_EQ(visits[k].poses.front().stamp_ns, (static_cast<int64_t>(k) + 1) * kHourNs);
  }
  EXPECT_EQ(visits[0].rig.name, "d455-1280");
  EXPECT_EQ(visits[1].rig.name, "d455-848");
  EXPECT_EQ(visits[3].rig.name, "d455-1280");
  SimulationOptions named = Options(3);
  named.cameras = {"euroc", "city"};
  named.rate_hz = 10;
  const auto others = Plan(named);
  EXPECT_EQ(others[2].rig.name, "euroc");
  EXPECT_EQ(others[0].poses[1].stamp_ns - others[0].poses[0].stamp_ns, 100'000'000);
}

TEST(VisitPlanTest, LongVisitsEndBeforeTheNextBegins) {
  SimulationOptions options = Options(2);
  options.path_m = 5000;
  const auto visits = Plan(options);
  EXPECT_LT(visits[0].poses.back().stamp_ns, visits[1].poses.front().stamp_ns);
  EXPECT_EQ(visits[1].poses.front().stamp_ns % kHourNs, 0);
}

TEST(VisitPlanTest, AVisitDoesNotDependOnThoseThatFollow) {
  const auto few = Plan(Options(2));
  const auto many = Plan(Options(9));
  for (size_t k = 0; k < few.size(); ++k) {
    ASSERT_EQ(few[k].poses.size(), many[k].poses.size());
    for (size_t i = 0; i < few[k].poses.size(); ++i) {
      ASSERT_EQ(few[k].poses[i].T_world_camera.Matrix(), many[k].poses[i].T_world_camera.Matrix());
    }
  }
}

std::vector<StampedPose> Flight() {
  std::vector<StampedPose> poses;
  for (int i = 0; i < 100; ++i) {
    poses.push_back({1'403'636'580'000'000'000 + int64_t{i} * 50'000'000,
                     Pose3(LookAlong(0.01 * i, 0.1, 0), {0.05 * i, 2 * std::sin(0.05 * i), 1.5})});
  }
  return poses;
}

TEST(VisitPlanTest, WaysAreWalkedAgainInAnotherManner) {
  SimulationOptions options = Options(4);
  options.num_routes = 2;
  const std::vector<Visit> visits = Plan(options);
  const RouteGraph ways = test::StreetWorld().routes;
  double apart_m = 0;
  for (size_t i = 0; i < visits[0].poses.size(); i += 20) {
    double nearest_m = 1e9;
    for (const StampedPose& again : visits[2].poses) {
      nearest_m = std::min(nearest_m, Distance(visits[0].poses[i].T_world_camera, again.T_world_camera));
    }
    EXPECT_LT(nearest_m, 2 * ways.clearance_m + 0.5) << "frame " << i;
    apart_m = std::max(apart_m, nearest_m);
  }
  EXPECT_GT(apart_m, 0.05) << "the same motion twice would be the same images twice";
}

TEST(VisitPlanTest, GivenTrajectoriesAreFlownAsTheyAre) {
  const mapp::test::TempFolder folder;
  ASSERT_TRUE(WriteTumTrajectory(folder.File("flight.txt"), Flight()).ok());
  SimulationOptions options = Options(3);
  options.trajectory_files = {folder.File("flight.txt")};
  const auto visits = Plan(options);
  const auto flight = Flight();
  for (size_t k = 0; k < visits.size(); ++k) {
    ASSERT_EQ(visits[k].poses.size(), flight.size());
    EXPECT_EQ(visits[k].poses[0].stamp_ns, (static_cast<int64_t>(k) + 1) * kHourNs);
    for (size_t i = 0; i < flight.size(); ++i) {
      EXPECT_EQ(visits[k].poses[i].stamp_ns - visits[k].poses[0].stamp_ns, flight[i].stamp_ns - flight[0].stamp_ns);
      EXPECT_LT(Distance(visits[k].poses[i].T_world_camera, flight[i].T_world_camera), 1e-5);
    }
  }
  options.max_duration_s = 1;
  const auto cut = Plan(options)[0].poses;
  EXPECT_LE(cut.back().stamp_ns - cut.front().stamp_ns, 1'000'000'000);
  EXPECT_LT(cut.size(), flight.size());
  options.max_duration_s = 0;
  options.rate_hz = 40;
  EXPECT_EQ(Plan(options)[0].poses.size(), 2 * flight.size() - 1);
}

TEST(VisitPlanTest, ATrajectoryThatLeavesTheWorldIsRefusedWithTimeAndPlace) {
  const mapp::test::TempFolder folder;
  auto flight = Flight();
  flight[40].T_world_camera = Pose3(flight[40].T_world_camera.rotation(), {2, 50, 1.5});
  ASSERT_TRUE(WriteTumTrajectory(folder.File("flight.txt"), flight).ok());
  SimulationOptions options = Options(1);
  options.trajectory_files = {folder.File("flight.txt")};
  const Status status = PlanVisits(test::StreetWorld(), options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()),
              testing::AllOf(HasSubstr("flight.txt"), HasSubstr("2.00 s"), HasSubstr("(2.00, 50.00, 1.50)")));
}

struct BadOption {
  const char* field;
  std::function<void(SimulationOptions&)> spoil;
};

class BadOptionTest : public testing::TestWithParam<BadOption> {};

TEST_P(BadOptionTest, IsNamed) {
  SimulationOptions options = Options(1);
  GetParam().spoil(options);
  const Status status = PlanVisits(test::StreetWorld(), options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::StartsWith(GetParam().field));
}

INSTANTIATE_TEST_SUITE_P(Options, BadOptionTest,
                         testing::Values(BadOption{"num_users", [](SimulationOptions& o) { o.num_users = 0; }},
                                         BadOption{"num_users", [](SimulationOptions& o) { o.num_users = 10'001; }},
                                         BadOption{"path_m", [](SimulationOptions& o) { o.path_m = 0; }},
                                         BadOption{"path_m", [](SimulationOptions& o) { o.path_m = std::nan(""); }},
                                         BadOption{"path_m", [](SimulationOptions& o) { o.path_m = 10'001; }},
                                         BadOption{"rate_hz", [](SimulationOptions& o) { o.rate_hz = -1; }},
                                         BadOption{"rate_hz", [](SimulationOptions& o) { o.rate_hz = 1e6; }},
                                         BadOption{"num_routes", [](SimulationOptions& o) { o.num_routes = 2; }},
                                         BadOption{"max_duration_s",
                                                   [](SimulationOptions& o) { o.max_duration_s = -1; }},
                                         BadOption{"camera", [](SimulationOptions& o) { o.cameras = {"d435"}; }}));

TEST(VisitPlanTest, AMissingTrajectoryIsNotFound) {
  SimulationOptions options = Options(1);
  options.trajectory_files = {"/nowhere/flight.txt"};
  EXPECT_EQ(PlanVisits(test::StreetWorld(), options).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp::sim
