#include "mapp/view/occupancy.h"

#include "mapp/base/rng.h"
#include "mapp/codec/occupancy_codec.h"
#include "mapp/codec/query_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

Camera Kinect() {
  return {.projection = PinholeCamera{.fx = 525, .fy = 525, .cx = 320, .cy = 240},
          .width_px = 640,
          .height_px = 480,
          .stereo_baseline_m = 0};
}

Eigen::Vector3d PointAt(double u_px, double v_px, double depth_m) { return depth_m * Kinect().Unproject({u_px, v_px}); }

/// A floor that runs away from the camera, and noise.
std::vector<Eigen::Vector3d> FloorPoints(Rng& rng, int count) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double v_px = rng.Uniform(250, 479);
    const double depth_m = 525 * 1.2 / (v_px - 240 + 20) * std::exp(0.02 * rng.Normal());
    points.push_back(PointAt(rng.Uniform(0, 639), v_px, depth_m));
  }
  return points;
}

void OccupyAll(OccupancyGrid& grid, const std::vector<Eigen::Vector3d>& points) {
  for (const Eigen::Vector3d& p_camera : points) {
    const auto location = grid.Locate(Kinect(), p_camera);
    ASSERT_TRUE(location.has_value());
    const Eigen::Vector3i bin = location->array().floor().cast<int>();
    grid.Occupy(bin.x(), bin.y(), bin.z());
  }
}

OccupancyGrid GridOf(const std::vector<Eigen::Vector3d>& points, OccupancyResolution resolution = {}) {
  OccupancyGrid grid(MakeQuerySketch(SamplerKind::kOccupancy, Kinect(), points), resolution);
  OccupyAll(grid, points);
  return grid;
}

bool SameBins(const OccupancyGrid& a, const OccupancyGrid& b) {
  if (a.num_bins() != b.num_bins() || !(a.resolution() == b.resolution())) return false;
  for (int row = 0; row < a.rows(); ++row) {
    for (int column = 0; column < a.columns(); ++column) {
      for (int depth = -2; depth < 300; ++depth) {
        if (a.IsOccupied(column, row, depth) != b.IsOccupied(column, row, depth)) return false;
      }
    }
  }
  return true;
}

TEST(OccupancyGridTest, EveryOwnPointHasABin) {
  Rng rng(1);
  const std::vector<Eigen::Vector3d> points = FloorPoints(rng, 900);
  for (const int steps : {1, 2, 5}) {
    const OccupancyGrid grid = GridOf(points, {.subdivision = 6, .depth_steps = steps});
    for (const Eigen::Vector3d& point : points) EXPECT_TRUE(grid.AnyWithin(*grid.Locate(Kinect(), point), 0));
  }
}

TEST(OccupancyGridTest, CellsWithoutDepthsHaveNoBins) {
  const std::vector<Eigen::Vector3d> corner = {PointAt(10, 10, 2.0), PointAt(20, 20, 2.2)};
  OccupancyGrid grid = GridOf(corner);
  // 2 m and 2.2 m are 3 or 4 codes apart: 2 or 3 bins, and one more at either end, in 36 columns.
  EXPECT_GE(grid.num_bins(), 36U * 4);
  EXPECT_LE(grid.num_bins(), 36U * 5);
  EXPECT_EQ(grid.DepthsOf(6, 0).count, 0);
  const size_t before = grid.num_occupied();
  grid.Occupy(6, 0, 100);
  grid.Occupy(-1, 0, 55);
  grid.Occupy(0, 18, 55);
  EXPECT_EQ(grid.num_occupied(), before);
}

TEST(OccupancyGridTest, ToleranceReachesIntoTheNextBinOnly) {
  const OccupancyGrid grid = GridOf({PointAt(330, 250, 2.0)});
  const Eigen::Vector3d bin = grid.Locate(Kinect(), PointAt(330, 250, 2.0))->array().floor();
  const Eigen::Vector3d center = bin + Eigen::Vector3d::Constant(0.5);
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Vector3d beside = center;
    beside[axis] += 0.9;
    EXPECT_FALSE(grid.AnyWithin(beside, 0));
    EXPECT_TRUE(grid.AnyWithin(beside, 0.5));
    beside[axis] += 0.2;
    EXPECT_FALSE(grid.AnyWithin(beside, 0.5));
  }
}

TEST(OccupancyGridTest, LocatesNothingBehindTheCameraOrOutsideTheImage) {
  const OccupancyGrid grid = GridOf({PointAt(330, 250, 2.0)});
  EXPECT_FALSE(grid.Locate(Kinect(), {0, 0, -1}).has_value());
  EXPECT_FALSE(grid.Locate(Kinect(), {5, 0, 1}).has_value());
  EXPECT_TRUE(grid.Locate(Kinect(), {0, 0, 500}).has_value());
}

TEST(OccupancyCodecTest, RoundTripsAnyBins) {
  Rng rng(2);
  for (int round = 0; round < 60; ++round) {
    DepthSketch sketch;
    for (DepthSketch::Cell& cell : sketch.cells) {
      if (rng.Below(4) == 0) continue;
      cell.near_code = static_cast<uint8_t>(1 + rng.Below(255));
      cell.far_code = static_cast<uint8_t>(cell.near_code + rng.Below(256U - cell.near_code));
    }
    OccupancyGrid grid(
        sketch, {.subdivision = 1 + static_cast<int>(rng.Below(8)), .depth_steps = 1 + static_cast<int>(rng.Below(6))});
    const double density = rng.Uniform();
    for (int row = 0; row < grid.rows(); ++row) {
      for (int column = 0; column < grid.columns(); ++column) {
        const OccupancyGrid::DepthRange depths = grid.DepthsOf(column, row);
        for (int i = 0; i < depths.count; ++i) {
          if (rng.Uniform() < density * density) grid.Occupy(column, row, depths.first + i);
        }
      }
    }
    const StatusOr<OccupancyGrid> back = DecodeOccupancy(EncodeOccupancy(grid), sketch);
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_TRUE(SameBins(grid, *back)) << "round " << round;
  }
}

TEST(OccupancyCodecTest, ExtremesAreSmall) {
  Rng rng(3);
  const DepthSketch sketch = MakeQuerySketch(SamplerKind::kOccupancy, Kinect(), FloorPoints(rng, 900));
  OccupancyGrid grid(sketch, {});
  EXPECT_EQ(EncodeOccupancy(grid).size(), 3U);
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      for (int i = 0; i < grid.DepthsOf(column, row).count; ++i)
        grid.Occupy(column, row, grid.DepthsOf(column, row).first + i);
    }
  }
  EXPECT_EQ(grid.num_occupied(), grid.num_bins());
  EXPECT_LT(EncodeOccupancy(grid).size(), 30U);
}

TEST(OccupancyCodecTest, ASurfaceTakesLessThanItsPointsEntropyAlone) {
  Rng rng(4);
  const OccupancyGrid grid = GridOf(FloorPoints(rng, 3000));
  const double p = static_cast<double>(grid.num_occupied()) / static_cast<double>(grid.num_bins());
  const double entropy_bits = -(p * std::log2(p) + (1 - p) * std::log2(1 - p));
  EXPECT_LT(static_cast<double>(EncodeOccupancy(grid).size()),
            0.9 * entropy_bits / 8 * static_cast<double>(grid.num_bins()));
}

TEST(OccupancyCodecTest, RefusesWhatDoesNotDescribeTheSketchsBins) {
  Rng rng(5);
  const std::vector<Eigen::Vector3d> points = FloorPoints(rng, 900);
  const DepthSketch sketch = MakeQuerySketch(SamplerKind::kOccupancy, Kinect(), points);
  const std::string good = EncodeOccupancy(GridOf(points));
  const auto refused = [](const std::string& bytes, const DepthSketch& asked) {
    return absl::IsInvalidArgument(DecodeOccupancy(bytes, asked).status());
  };
  EXPECT_TRUE(refused("", sketch));
  EXPECT_TRUE(refused(good.substr(0, 1), sketch));
  EXPECT_TRUE(refused(good.substr(0, good.size() / 2), sketch));
  EXPECT_TRUE(refused(good, DepthSketch{}));
  std::string no_columns = good;
  no_columns[0] = 0;
  EXPECT_TRUE(refused(no_columns, sketch));
  std::string too_fine = good;
  too_fine[0] = 17;
  EXPECT_TRUE(refused(too_fine, sketch));
  EXPECT_TRUE(refused(std::string("\x06\x02\x00\x55", 4), sketch)) << "none announced, and yet there is something";
}

TEST(OverlapAnswerTest, EachKindTravelsAsItself) {
  Rng rng(6);
  const std::vector<Eigen::Vector3d> points = FloorPoints(rng, 900);
  ViewQuery query;
  query.sampler = SamplerKind::kOccupancy;
  query.sketch = MakeQuerySketch(query.sampler, Kinect(), points);
  const OccupancyGrid grid = GridOf(points);
  const StatusOr<OverlapAnswer> bins = DecodeOverlapAnswer(EncodeOverlapAnswer(grid), query, 1000);
  ASSERT_TRUE(bins.ok()) << bins.status();
  EXPECT_TRUE(SameBins(std::get<OccupancyGrid>(*bins), grid));

  query.sampler = SamplerKind::kDepthSketch;
  const SampleStates states{std::vector<bool>(1000, true)};
  const StatusOr<OverlapAnswer> sampled = DecodeOverlapAnswer(EncodeOverlapAnswer(states), query, 1000);
  ASSERT_TRUE(sampled.ok()) << sampled.status();
  EXPECT_EQ(std::get<SampleStates>(*sampled).redundant, states.redundant);
}

TEST(OverlapAnswerTest, TheDeviceCountsItsPointsInOccupiedBins) {
  const std::vector<Eigen::Vector3d> known = {PointAt(100, 100, 2), PointAt(400, 300, 3)};
  std::vector<Eigen::Vector3d> own = known;
  own.push_back(PointAt(100, 100, 4));  // behind
  own.push_back(PointAt(600, 40, 2));   // elsewhere
  const OverlapQuestion question{.camera = Kinect(),
                                 .cone_range_m = 20,
                                 .sampler = SamplerKind::kOccupancy,
                                 .sketch = MakeQuerySketch(SamplerKind::kOccupancy, Kinect(), own),
                                 .num_samples = 0};
  OccupancyGrid grid(question.sketch, {});
  OccupyAll(grid, known);
  const OverlapCount count = CountOverlap(question, grid, own);
  EXPECT_EQ(count.redundant, (std::vector<bool>{true, true, false, false}));
  EXPECT_DOUBLE_EQ(count.overlap, 0.5);
  EXPECT_EQ(CountOverlap(question, grid, {}).overlap, 0);
}

}  // namespace
}  // namespace mapp
