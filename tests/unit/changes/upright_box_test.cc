#include "server/changes/upright_box.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

const Eigen::Vector3d kUp = -Eigen::Vector3d::UnitY();

TEST(UprightBoxTest, FindsABoxThatIsTurned) {
  const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY()));
  const OrientedBox truth{Pose3(turned, {3, -0.75, 8}), {1.8, 1.5, 4.2}};
  Rng rng(1);
  std::vector<Eigen::Vector3f> p_map;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d share(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5));
    p_map.push_back((truth.T_frame_box * share.cwiseProduct(truth.size_m)).cast<float>());
  }
  p_map.emplace_back(9.0F, 0.0F, 9.0F);  // a stray
  const OrientedBox box = UprightBox(p_map, kUp, 0.02, 0.05);
  EXPECT_GT(IntersectionOverUnion(box, truth), 0.8);
}

TEST(UprightBoxTest, NoSideIsWithoutLength) {
  const std::vector<Eigen::Vector3f> one = {{1, 2, 3}};
  const OrientedBox box = UprightBox(one, kUp, 0.02, 0.05);
  EXPECT_TRUE((box.size_m.array() >= 0.05 - 1e-12).all());
  EXPECT_TRUE(box.Contains({1, 2, 3}, 1e-6));
}

TEST(UprightBoxTest, UpIsAgainstTheCamerasDownwardAxes) {
  std::vector<FrameRecord> frames(2);
  frames[0].T_frame_camera =
      Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX())), Eigen::Vector3d::Zero());
  frames[1].T_frame_camera =
      Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitX())), Eigen::Vector3d::Zero());
  EXPECT_LT((UpDirection(frames) - kUp).norm(), 1e-9);
  EXPECT_EQ(UpDirection({}), kUp);
}

TEST(UprightBoxTest, AThingSeenFromOneSideReachesAway) {
  const OrientedBox face{Pose3(Eigen::Quaterniond::Identity(), {0, -0.7, 5}), {1.8, 1.4, 0.4}};
  // Sides in UprightBox's order: two on the ground, then the height.
  OrientedBox upright = face;
  upright.T_frame_box = Pose3(Eigen::Quaterniond((Eigen::Matrix3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished()),
                              face.T_frame_box.translation());
  upright.size_m = {1.8, 0.4, 1.4};
  const std::vector<OrientedBox> boxes = WithHiddenPart(upright, {0, 0, 1});
  ASSERT_EQ(boxes.size(), 1U);
  const OrientedBox& whole = boxes.front();
  EXPECT_GT(whole.size_m.y(), 2);
  EXPECT_GT(whole.T_frame_box.translation().z(), 5.8);
  EXPECT_TRUE(whole.Contains({0, -0.7, 4.81}));
  EXPECT_FALSE(whole.Contains({0, -0.7, 4.7}));
  // From all around nothing is hidden.
  EXPECT_EQ(WithHiddenPart(upright, {0, 0, 0.1}).front().size_m, upright.size_m);
  // From a corner either side may go on.
  EXPECT_EQ(WithHiddenPart(upright, {0.7, 0, 0.7}).size(), 1U);  // it is as long as it is high
  upright.size_m.x() = 0.8;
  EXPECT_EQ(WithHiddenPart(upright, {0.7, 0, 0.7}).size(), 2U);
}

}  // namespace
}  // namespace mapp
