#include "server/service/view_search.h"

#include "mapp/base/rng.h"
#include "mapp/view/sampler.h"
#include "server/service/scaled_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace mapp::testing {
namespace {

TEST(BoundingRadiusTest, HoldsTheScaledBall) {
  Rng rng(1);
  for (int i = 0; i < 20'000; ++i) {
    const double z = rng.Uniform(0.2, 30);
    const Eigen::Vector3d center(z * rng.Uniform(-1, 1), z * rng.Uniform(-1, 1), z);
    const double radius = rng.Uniform(0.02, 0.3);
    // On the surface of the ball, where the distance is greatest.
    Eigen::Vector3d offset(rng.Normal(), rng.Normal(), rng.Normal());
    offset *= radius / offset.norm();
    const double z_there = z * std::exp(2 * offset.z());
    const Eigen::Vector3d there(z_there * (center.x() / z + offset.x()), z_there * (center.y() / z + offset.y()),
                                z_there);
    const float bound = BoundingRadius(center.cast<float>(), static_cast<float>(radius));
    ASSERT_LE((there - center).norm(), bound * (1 + 1e-5)) << center.transpose() << ", radius " << radius;
  }
}

/// A tile of random points, each seen by one of two frames: one looks as the view does, one the other way.
class ViewSearchTest : public ::testing::Test {
 protected:
  ViewSearchTest() {
    const Pose3 alike(Eigen::Quaterniond::Identity(), Eigen::Vector3d(4, 4, -1));
    const Pose3 opposite(Eigen::Quaterniond(Eigen::AngleAxisd(3.14159, Eigen::Vector3d::UnitY())),
                         Eigen::Vector3d(4, 4, 12));
    const std::vector<ObserverFrame> frames = {{{FrameId(1), alike, 1.1F}, SessionId(1)},
                                               {{FrameId(2), opposite, 1.1F}, SessionId(1)}};
    Rng rng(2);
    for (uint64_t id = 1; id <= 4000; ++id) {
      PointRecord point;
      point.id = MapPointId(id);
      point.position = {rng.Uniform(0, 8), rng.Uniform(0, 8), rng.Uniform(0, 8)};
      point.observers = {FrameId(1 + rng.Below(2))};
      points_.push_back(point);
    }
    tile_ = *LoadedTile::Create({0, 0, 0}, Revision(1), points_, frames);
  }

  bool SeenAlike(const PointRecord& point) const {
    if (point.observers[0] != FrameId(1)) return false;
    const Eigen::Vector3d ray = (point.position - cone_.T_map_camera.translation()).normalized();
    const Eigen::Vector3d frame_ray = (point.position - Eigen::Vector3d(4, 4, -1)).normalized();
    return ray.dot(frame_ray) >= std::cos(kLikeViewAngle);
  }

  const ViewCone cone_{
      Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY())), Eigen::Vector3d(3, 4, -0.5)), 20,
      1.1};
  std::vector<PointRecord> points_;
  std::shared_ptr<const LoadedTile> tile_;
};

TEST_F(ViewSearchTest, ScaledSearchAgreesWithBruteForce) {
  const Pose3 T_camera_map = cone_.T_map_camera.Inverse();
  Rng rng(3);
  constexpr float kRadius = 0.07F;
  std::vector<Eigen::Vector3f> samples;
  for (int i = 0; i < 500; ++i) {
    const double z = rng.Uniform(0.5, 9);
    samples.emplace_back(Eigen::Vector3d(z * rng.Uniform(-0.6, 0.6), z * rng.Uniform(-0.5, 0.5), z).cast<float>());
  }
  const std::vector<bool> found = ViewSearch(cone_, {tile_}).AnyWithinScaled(samples, kRadius);
  ASSERT_EQ(found.size(), samples.size());
  for (size_t i = 0; i < samples.size(); ++i) {
    const bool expected = std::any_of(points_.begin(), points_.end(), [&](const PointRecord& point) {
      const Eigen::Vector3f p_camera = (T_camera_map * point.position).cast<float>();
      return p_camera.z() > 0 && (ScaledCoordinates(p_camera) - ScaledCoordinates(samples[i])).norm() <= kRadius &&
             SeenAlike(point);
    });
    EXPECT_EQ(found[i], expected) << samples[i].transpose();
  }
  EXPECT_GT(std::count(found.begin(), found.end(), true), 50);
  EXPECT_GT(std::count(found.begin(), found.end(), false), 50);
}

TEST_F(ViewSearchTest, MetricSearchCountsNeighborFramesOnly) {
  Rng rng(4);
  std::vector<Eigen::Vector3f> samples;
  for (int i = 0; i < 300; ++i) {
    samples.emplace_back(Eigen::Vector3d(rng.Uniform(-3, 3), rng.Uniform(-3, 3), rng.Uniform(0, 8)).cast<float>());
  }
  const std::vector<bool> found = ViewSearch(cone_, {tile_}).AnyWithin(samples, 0.4F);
  for (size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d p_map = cone_.T_map_camera * samples[i].cast<double>();
    const bool expected = std::any_of(points_.begin(), points_.end(), [&](const PointRecord& point) {
      return point.observers[0] == FrameId(1) && (point.position - p_map).norm() < 0.4;
    });
    EXPECT_EQ(found[i], expected);
  }
}

TEST_F(ViewSearchTest, WithoutTilesNothingIsKnown) {
  ViewSearch search(cone_, {});
  const std::vector<Eigen::Vector3f> samples = {{0, 0, 2}, {1, 0, 3}};
  EXPECT_EQ(search.AnyWithin(samples, 10), std::vector<bool>(2, false));
  EXPECT_EQ(search.AnyWithinScaled(samples, 0.5F), std::vector<bool>(2, false));
  EXPECT_TRUE(search.AnyWithinScaled({}, 0.5F).empty());
}

TEST(ScaledGridTest, AgreesWithBruteForce) {
  Rng rng(5);
  // Thin, flat and wide sets of points: the last one has more extent than cells of the radius' size.
  for (const Eigen::Vector3d& size : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 1, 0), Eigen::Vector3d(9, 2, 1)}) {
    std::vector<Eigen::Vector3f> points;
    const auto random_point = [&](double margin) -> Eigen::Vector3f {
      const Eigen::Vector3d unit(rng.Uniform(), rng.Uniform(), rng.Uniform());
      const Eigen::Vector3d spread = size + Eigen::Vector3d::Constant(2 * margin);
      return (unit.cwiseProduct(spread) - Eigen::Vector3d::Constant(margin)).cast<float>();
    };
    for (int i = 0; i < 800; ++i) points.push_back(random_point(0));
    constexpr float kRadius = 0.08F;
    const ScaledGrid grid(points, kRadius);
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector3f asked = random_point(0.15);
      const bool expected = std::any_of(points.begin(), points.end(), [&](const Eigen::Vector3f& point) {
        return (point - asked).squaredNorm() <= kRadius * kRadius;
      });
      EXPECT_EQ(grid.AnyWithin(asked), expected);
    }
  }
}

}  // namespace
}  // namespace mapp::testing
