#include "mapp/view/point_judge.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

namespace mapp {
namespace {

constexpr double kRangeM = 12;
constexpr double kWallM = 5;

Camera JudgeCamera() {
  return {.projection = PinholeCamera{525, 525, 319.5, 239.5}, .width_px = 640, .height_px = 480};
}

/// A view from `x_m` on a wall across its way.
MeasuredView ViewOfWall(double x_m = 0, bool partial = false) {
  Keyframe keyframe;
  keyframe.partial = partial;
  for (float u_px = 4; u_px < 640; u_px += 12) {
    for (float v_px = 4; v_px < 480; v_px += 12) {
      KeyframeFeature feature;
      feature.keypoint = {.u_px = u_px, .v_px = v_px};
      feature.point.emplace();
      feature.point->depth_m = static_cast<float>(kWallM);
      keyframe.features.push_back(feature);
    }
  }
  const Pose3 T_map_camera(Eigen::Quaterniond::Identity(), {x_m, 0, 0});
  return MeasuredView(keyframe, T_map_camera, JudgeCamera(), kRangeM, /*scale=*/1);
}

/// Points that were seen from the map's origin.
class TileMaker {
 public:
  void AddBlock(size_t num, const Eigen::Vector3d& center_map, double edge_m, SessionId founder = SessionId(1)) {
    for (size_t i = 0; i < num; ++i) {
      const auto at = [&] { return rng_.Uniform(-0.5 * edge_m, 0.5 * edge_m); };
      Add(center_map + Eigen::Vector3d(at(), at(), 0), founder);
    }
  }
  void Add(const Eigen::Vector3d& p_map, SessionId founder = SessionId(1)) {
    SightedPoint point;
    point.p_map = p_map.cast<float>();
    point.id = MapPointId(points_.size() + 1);
    point.founder = founder;
    point.reference_distance_m = 1.5F * point.p_map.norm();
    point.directions[point.num_directions++] = point.p_map.normalized();
    points_.push_back(point);
  }
  SightedPoints Make() const { return std::make_shared<const SightedTile>(points_); }

 private:
  Rng rng_{1};
  std::vector<SightedPoint> points_;
};

std::pair<size_t, size_t> SeenAndMissed(const std::vector<PointFinding>& findings) {
  std::pair<size_t, size_t> counts;
  for (const PointFinding& one : findings) ++(one.num_seen > one.num_missed ? counts.first : counts.second);
  return counts;
}

TEST(SightedTileTest, BlocksHoldEveryPointOnce) {
  TileMaker maker;
  maker.AddBlock(700, {0, 0, 5}, 4);
  maker.AddBlock(50, {-3, 1, -2}, 1);
  const SightedPoints tile = maker.Make();
  std::set<MapPointId> ids;
  uint32_t begin = 0;
  for (const SightedTile::Block& block : tile->blocks()) {
    EXPECT_EQ(block.begin, begin);
    EXPECT_LT(block.begin, block.end);
    EXPECT_LT(block.radius_m, 1);
    begin = block.end;
    for (const SightedPoint& point : tile->points().subspan(block.begin, block.end - block.begin)) {
      EXPECT_LE((point.p_map - block.center_map).norm(), block.radius_m + 1e-5F);
      ids.insert(point.id);
    }
  }
  EXPECT_EQ(begin, tile->points().size());
  EXPECT_EQ(ids.size(), 750U);
  EXPECT_TRUE(SightedTile({}).blocks().empty());
}

TEST(PointJudgeTest, ToldByWhereSurfacesAre) {
  TileMaker maker;
  maker.AddBlock(40, {0, 0, kWallM}, 1);   // on the wall
  maker.AddBlock(30, {0.5, 0, 2.5}, 0.4);  // rays go through it to the wall
  maker.AddBlock(20, {-1, 0, 9}, 1);       // hidden by the wall, and beyond all that was measured
  maker.AddBlock(20, {0, 0, -3}, 1);       // behind the camera
  maker.AddBlock(20, {9, 0, 4}, 1);        // beside the image
  PointJudge judge{PointJudgeOptions{}};
  judge.Add(ViewOfWall(), {{maker.Make()}});
  const std::vector<PointFinding> findings = judge.Conclude();
  EXPECT_EQ(SeenAndMissed(findings), (std::pair<size_t, size_t>{40, 30}));
  EXPECT_TRUE(std::ranges::is_sorted(findings, {}, &PointFinding::point));
}

TEST(PointJudgeTest, LaterFoundersAreNotJudged) {
  TileMaker maker;
  maker.AddBlock(10, {0, 0, kWallM}, 1, SessionId(2));
  maker.AddBlock(20, {0, 0, kWallM}, 1, SessionId(3));
  PointJudge judge(PointJudgeOptions{}, SessionId(2));
  judge.Add(ViewOfWall(), {{maker.Make()}});
  EXPECT_EQ(judge.Conclude().size(), 10U);
}

TEST(PointJudgeTest, APartialViewMissesNothing) {
  TileMaker maker;
  maker.AddBlock(30, {0, 0, 2.5}, 0.4);
  PointJudge judge{PointJudgeOptions{}};
  judge.Add(ViewOfWall(0, /*partial=*/true), {{maker.Make()}});
  EXPECT_TRUE(judge.Conclude().empty());
}

TEST(PointJudgeTest, WhatIsMissedAloneIsChance) {
  TileMaker maker;
  maker.Add({0.5, 0, 2.5});                  // nothing near it
  maker.AddBlock(40, {-0.5, 0, kWallM}, 1);  // seen
  maker.Add({-0.5, 0, kWallM - 0.9});        // missed between them
  PointJudge judge{PointJudgeOptions{.neighbor_radius_m = 1.2F}};
  judge.Add(ViewOfWall(), {{maker.Make()}});
  EXPECT_EQ(SeenAndMissed(judge.Conclude()), (std::pair<size_t, size_t>{40, 0}));
}

TEST(PointJudgeTest, SharedOutAmongThreadsItSaysTheSame) {
  TileMaker maker;
  maker.AddBlock(900, {0, 0, kWallM}, 3);
  maker.AddBlock(3000, {0, 0, 2.5}, 1.5);
  maker.AddBlock(500, {0.5, 0, 4}, 1.5);
  const SightedPoints tiles[] = {maker.Make()};
  PointJudge alone{PointJudgeOptions{}}, first{PointJudgeOptions{}}, second{PointJudgeOptions{}};
  for (int i = 0; i < 8; ++i) {
    const MeasuredView view = ViewOfWall(0.2 * i - 0.8);
    alone.Add(view, tiles);
    (i % 2 == 0 ? first : second).Add(view, tiles);
  }
  first.Merge(std::move(second));
  const std::vector<PointFinding> expected = alone.Conclude();
  EXPECT_GT(SeenAndMissed(expected).first, 500U);
  EXPECT_GT(SeenAndMissed(expected).second, 2000U);
  EXPECT_EQ(first.Conclude(), expected);
  EXPECT_EQ(first.Conclude(/*num_threads=*/3), expected);
}

}  // namespace
}  // namespace mapp
