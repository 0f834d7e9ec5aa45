#include "sim/world/world.h"

#include "sim/scene_rays.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <set>

namespace mapp::sim {
namespace {

using testing::HasSubstr;

constexpr int64_t kHour_ns = 3'600'000'000'000;

WorldOptions OptionsOf(const std::string& setting) {
  WorldOptions options;
  options.setting = setting;
  options.seed = 4;
  options.num_changes = 7;
  options.num_passers = 3;
  for (int64_t hour = 1; hour < 4; ++hour)
    options.visits_ns.emplace_back(hour * kHour_ns, hour * kHour_ns + kHour_ns / 4);
  return options;
}

/// The world of OptionsOf(), made once for all tests.
const World& WorldOf(const std::string& setting) {
  static std::map<std::string, std::shared_ptr<const World>> worlds;
  std::shared_ptr<const World>& world = worlds[setting];
  if (!world) world = MakeWorld(OptionsOf(setting)).value();
  return *world;
}

bool Same(const Quad& a, const Quad& b) {
  return a.corner_world == b.corner_world && a.edge_u_world == b.edge_u_world && a.edge_v_world == b.edge_v_world &&
         a.window == b.window && a.object_id == b.object_id && a.texture->width() == b.texture->width() &&
         a.texture->Sample(0.37F, 0.61F, 1) == b.texture->Sample(0.37F, 0.61F, 1);
}

class WorldTest : public testing::TestWithParam<std::string> {};

TEST_P(WorldTest, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const Scene scene = SceneAt(WorldOf(GetParam()), 0);
  WorldOptions options = OptionsOf(GetParam());
  const Scene again = SceneAt(*MakeWorld(options).value(), 0);
  ASSERT_EQ(again.quads.size(), scene.quads.size());
  EXPECT_TRUE(std::ranges::equal(again.quads, scene.quads, Same));
  options.seed = 5;
  EXPECT_FALSE(std::ranges::equal(SceneAt(*MakeWorld(options).value(), 0).quads, scene.quads, Same));
}

TEST_P(WorldTest, SurfacesAreRectanglesWithPictures) {
  for (const Quad& quad : SceneAt(WorldOf(GetParam()), 0).quads) {
    ASSERT_NE(quad.texture, nullptr);
    const double cosine = quad.edge_u_world.normalized().dot(quad.edge_v_world.normalized());
    ASSERT_NEAR(cosine, 0, 1e-9) << quad.corner_world.transpose();
    ASSERT_GT(quad.edge_u_world.norm(), 1e-3) << quad.corner_world.transpose();
    ASSERT_GT(quad.edge_v_world.norm(), 1e-3) << quad.corner_world.transpose();
  }
}

TEST_P(WorldTest, RoutesAreFreeAtAllTimes) {
  const World& world = WorldOf(GetParam());
  const RouteGraph& routes = world.routes;
  ASSERT_GE(routes.nodes_world.size(), 10);
  ASSERT_GE(routes.edges.size(), routes.nodes_world.size() - 1);
  EXPECT_GE(routes.clearance_m, 0.5);
  for (const int64_t stamp_ns : {int64_t{0}, 9 * kHour_ns}) {
    const SceneRays rays(std::make_shared<const Scene>(SceneAt(world, stamp_ns)));
    for (const auto& [a, b] : routes.edges) {
      const Eigen::Vector3d way = routes.nodes_world.at(b) - routes.nodes_world.at(a);
      ASSERT_GT(way.norm(), 0.5);
      for (double along = 0; along <= 1; along += 0.13 / way.norm()) {
        const Eigen::Vector3d p_world = routes.nodes_world[a] + along * way;
        ASSERT_TRUE(world.bounds_world.contains(p_world)) << p_world.transpose();
        ASSERT_GE(rays.DistanceToSurface(p_world), routes.clearance_m) << p_world.transpose();
      }
    }
  }
}

TEST_P(WorldTest, RoutesAreOneGraph) {
  const RouteGraph& routes = WorldOf(GetParam()).routes;
  std::set<size_t> reached = {0};
  for (size_t before = 0; before < reached.size();) {
    before = reached.size();
    for (const auto& [a, b] : routes.edges) {
      if (reached.contains(a) || reached.contains(b)) reached.insert({a, b});
    }
  }
  EXPECT_EQ(reached.size(), routes.nodes_world.size());
}

TEST_P(WorldTest, EqualModelsLookEqual) {
  std::map<uint32_t, const WorldObject*> first_of;
  int num_equal = 0;
  for (const WorldObject& object : WorldOf(GetParam()).objects) {
    const auto [it, is_first] = first_of.emplace(object.model, &object);
    if (is_first) continue;
    ++num_equal;
    EXPECT_EQ(object.kind, it->second->kind);
    ASSERT_EQ(object.quads_object.size(), it->second->quads_object.size());
    for (size_t i = 0; i < object.quads_object.size(); ++i) {
      EXPECT_EQ(object.quads_object[i].texture, it->second->quads_object[i].texture);
      EXPECT_EQ(object.quads_object[i].corner_world, it->second->quads_object[i].corner_world);
      EXPECT_EQ(object.quads_object[i].object_id, object.id);
    }
  }
  EXPECT_GT(num_equal, 0);
}

TEST_P(WorldTest, ObjectsFillTheirBoxes) {
  for (const WorldObject& object : WorldOf(GetParam()).objects) {
    Aabb box;
    for (const Quad& quad : object.quads_object) {
      box.extend(quad.corner_world);
      box.extend(Eigen::Vector3d(quad.corner_world + quad.edge_u_world + quad.edge_v_world));
    }
    EXPECT_LE((box.max() - 0.5 * object.size_m).maxCoeff(), 1e-6) << object.kind << object.model;
    EXPECT_LE((-0.5 * object.size_m - box.min()).maxCoeff(), 1e-6) << object.kind << object.model;
    EXPECT_GE((box.sizes() - 0.7 * object.size_m).minCoeff(), 0) << object.kind << object.model;
  }
}

TEST_P(WorldTest, ChangesFallBetweenVisitsAndShowInTheScene) {
  const World& world = WorldOf(GetParam());
  const WorldOptions options = OptionsOf(GetParam());
  const std::vector<WorldChange> changes = ChangesOf(world);
  ASSERT_EQ(changes.size(), static_cast<size_t>(options.num_changes));
  const auto count_quads = [&](int64_t stamp_ns, uint32_t id) {
    return std::ranges::count(SceneAt(world, stamp_ns).quads, id, &Quad::object_id);
  };
  std::set<ChangeKind> kinds;
  for (const WorldChange& change : changes) {
    kinds.insert(change.kind);
    for (const auto& [from_ns, to_ns] : options.visits_ns) {
      EXPECT_FALSE(change.stamp_ns > from_ns && change.stamp_ns < to_ns) << change.stamp_ns;
    }
    EXPECT_GE(change.stamp_ns, options.visits_ns.front().second);
    EXPECT_LT(change.stamp_ns, options.visits_ns.back().first);
    EXPECT_EQ(change.T_world_object_before.has_value(), change.kind != ChangeKind::kAppeared);
    EXPECT_EQ(change.T_world_object_after.has_value(), change.kind != ChangeKind::kVanished);
    const WorldObject& object = world.objects.at(change.object_id - 1);
    ASSERT_EQ(object.id, change.object_id);
    const auto num_quads = static_cast<std::ptrdiff_t>(object.quads_object.size());
    EXPECT_EQ(count_quads(change.stamp_ns - 1, object.id), change.T_world_object_before ? num_quads : 0);
    EXPECT_EQ(count_quads(change.stamp_ns, object.id), change.T_world_object_after ? num_quads : 0);
    if (change.kind == ChangeKind::kMoved) {
      EXPECT_GT(Distance(*change.T_world_object_before, *change.T_world_object_after), 0.3);
    }
  }
  EXPECT_EQ(kinds.size(), 3);
  // Both times between the three visits see some of them.
  EXPECT_LT(changes.front().stamp_ns, options.visits_ns[1].first);
  EXPECT_GT(changes.back().stamp_ns, options.visits_ns[1].second - 1);
}

TEST_P(WorldTest, OnlyWhatIsAllowedChangesWhereAndWhenItMay) {
  WorldOptions options = OptionsOf(GetParam());
  options.num_changes = 2;
  options.num_stable_visits = 2;
  options.change_kinds = {ChangeKind::kVanished};
  const World& known = WorldOf(GetParam());
  const auto first = std::ranges::find_if(
      known.objects, [](const WorldObject& object) { return object.placements.front().T_world_object.has_value(); });
  ASSERT_NE(first, known.objects.end());
  options.change_near_world = {first->placements.front().T_world_object->translation()};
  options.change_reach_m = 25;
  const std::vector<WorldChange> changes = ChangesOf(*MakeWorld(options).value());
  ASSERT_EQ(changes.size(), 2U);
  for (const WorldChange& change : changes) {
    EXPECT_EQ(change.kind, ChangeKind::kVanished);
    EXPECT_GE(change.stamp_ns, options.visits_ns[1].second);
    EXPECT_LT(change.stamp_ns, options.visits_ns[2].first);
    EXPECT_LE((change.T_world_object_before->translation() - options.change_near_world.front()).norm(), 25);
  }
}

TEST_P(WorldTest, PeopleWalkOnTheGroundInside) {
  const World& world = WorldOf(GetParam());
  const std::vector<Quad> before = PassersAt(world, 1'500'000'000'000'000'000);
  const std::vector<Quad> after = PassersAt(world, 1'500'000'001'000'000'000);
  ASSERT_EQ(before.size(), after.size());
  ASSERT_FALSE(before.empty());
  for (size_t i = 0; i < before.size(); ++i) {
    const double walked_m = (after[i].corner_world - before[i].corner_world).norm();
    EXPECT_GT(walked_m, 0.05);
    EXPECT_LT(walked_m, 2.5);
    EXPECT_TRUE(world.bounds_world.contains(after[i].corner_world)) << after[i].corner_world.transpose();
  }
}

TEST_P(WorldTest, KeepsGivenSpaceFree) {
  WorldOptions options = OptionsOf(GetParam());
  options.num_changes = 0;
  const World& world = WorldOf(GetParam());
  // Where things stand now nothing may stand then.
  for (size_t i = 0; i < std::min<size_t>(world.objects.size(), 5); ++i) {
    const auto& T_world_object = world.objects[i].placements.front().T_world_object;
    if (T_world_object) options.keep_free_world.push_back(T_world_object->translation());
  }
  ASSERT_FALSE(options.keep_free_world.empty());
  const std::shared_ptr<const World> kept = MakeWorld(options).value();
  for (const Eigen::Vector3d& p_world : options.keep_free_world) {
    EXPECT_TRUE(kept->bounds_world.contains(p_world));
    for (const WorldObject& object : kept->objects) {
      const Eigen::Vector3d p_object = object.At(0)->Inverse() * p_world;
      EXPECT_GE((p_object.cwiseAbs() - 0.5 * object.size_m).cwiseMax(0.0).norm(), options.clearance_m - 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, WorldTest, testing::ValuesIn(SettingNames()),
                         [](const auto& instance) { return instance.param; });

struct BadCase {
  std::string name;
  std::string field;
  std::function<void(WorldOptions&)> spoil;
};

class WorldOptionsTest : public testing::TestWithParam<BadCase> {};

TEST_P(WorldOptionsTest, BadOptionIsNamed) {
  WorldOptions options;
  options.setting = "hall";
  GetParam().spoil(options);
  const Status status = MakeWorld(options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(GetParam().field));
}

INSTANTIATE_TEST_SUITE_P(
    All, WorldOptionsTest,
    testing::Values(
        BadCase{"Setting", "setting: unknown \"moon\"", [](WorldOptions& options) { options.setting = "moon"; }},
        BadCase{"NegativeChanges", "num_changes", [](WorldOptions& options) { options.num_changes = -1; }},
        BadCase{"TooManyChanges", "num_changes: 5000", [](WorldOptions& options) { options.num_changes = 5000; }},
        BadCase{"Passers", "num_passers", [](WorldOptions& options) { options.num_passers = 100000; }},
        BadCase{"StableVisits", "num_stable_visits: 4 is not in [0, 3]",
                [](WorldOptions& options) {
                  options.visits_ns = {{1, 2}, {3, 4}, {5, 6}};
                  options.num_stable_visits = 4;
                }},
        BadCase{"ChangeReach", "change_reach_m", [](WorldOptions& options) { options.change_reach_m = -1; }},
        BadCase{"NothingInReach", "num_changes: 1, but the hall has 0",
                [](WorldOptions& options) {
                  options.num_changes = 1;
                  options.change_near_world = {{0, 0, 500}};
                  options.change_reach_m = 1;
                }},
        BadCase{"Clearance", "clearance_m", [](WorldOptions& options) { options.clearance_m = -0.1; }},
        BadCase{"Visit", "visits_ns",
                [](WorldOptions& options) {
                  options.visits_ns = {{5, 4}};
                }},
        BadCase{"KeepFree", "keep_free_world",
                [](WorldOptions& options) {
                  options.keep_free_world = {{NAN, 0, 0}};
                }},
        BadCase{"NoPhotograph", "textures_folder",
                [](WorldOptions& options) {
                  options.textures_folder = testing::TempDir() + "/mapp_no_photographs";
                  std::filesystem::create_directories(options.textures_folder);
                }}),
    [](const auto& instance) { return instance.param.name; });

TEST(WorldOptionsErrorTest, MissingTextureFolderIsNotFound) {
  WorldOptions options;
  options.textures_folder = "/no/such/folder";
  EXPECT_EQ(MakeWorld(options).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp::sim
