#include "server/service/odometry_links.h"

#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::MapFixture;
using testing::SyntheticRoom;

class OdometryLinksTest : public ::testing::Test {
 protected:
  static FrameView Sent(SessionId session, uint32_t number, double x_m, PoseFrame pose_frame = PoseFrame::kSession) {
    FrameView view;
    view.record.session = session;
    view.record.number = number;
    view.record.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), {0, 99, 0});  // corrected since: not asked
    view.keyframe.pose_frame = pose_frame;
    view.keyframe.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), {x_m, 0, 0});
    return view;
  }
  std::vector<BundleProblem::RelativePose> Build() {
    const auto built = links_.Build(*fixture_.Read());
    EXPECT_TRUE(built.ok()) << built.status();
    return *built;
  }

  MapFixture fixture_;
  SessionId session_ = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true);
  OdometryLinks links_;
};

TEST_F(OdometryLinksTest, JoinsNeighborsInNumberByWhatWasSent) {
  links_.Add(0, Sent(session_, 7, 1.5));
  links_.Add(1, Sent(session_, 2, 0.5));
  links_.Add(2, Sent(session_, 4, 0.75));
  const auto links = Build();
  ASSERT_EQ(links.size(), 2U);
  EXPECT_EQ(links[0].from_idx, 1);
  EXPECT_EQ(links[0].to_idx, 2);
  EXPECT_NEAR(links[0].T_from_to.translation().x(), 0.25, 1e-12);
  EXPECT_EQ(links[1].from_idx, 2);
  EXPECT_EQ(links[1].to_idx, 0);
  EXPECT_NEAR(links[1].T_from_to.translation().x(), 0.75, 1e-12);
  EXPECT_GT(links[1].sigma_m, links[0].sigma_m) << "drift grows with the way";
}

TEST_F(OdometryLinksTest, SessionsAreNotJoined) {
  const SessionId other = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/false);
  links_.Add(0, Sent(session_, 0, 0));
  links_.Add(1, Sent(other, 1, 1));
  EXPECT_TRUE(Build().empty());
}

TEST_F(OdometryLinksTest, AStepOntoASharedMapIsLooserAndInOneFrame) {
  links_.Add(0, Sent(session_, 0, 0));
  links_.Add(1, Sent(session_, 1, 0.2));
  links_.Add(2, Sent(session_, 2, 0.4, PoseFrame::kMap));
  const auto links = Build();
  ASSERT_EQ(links.size(), 2U);
  EXPECT_NEAR(links[1].T_from_to.translation().x(), 0.2, 1e-9) << "the founder's frame is the map's";
  EXPECT_GT(links[1].sigma_m, 5 * links[0].sigma_m);
}

TEST_F(OdometryLinksTest, WithoutScaleThereIsNothingToJoin) {
  const SessionId mono = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/false, SensorKind::kMono);
  links_.Add(0, Sent(mono, 0, 0));
  links_.Add(1, Sent(mono, 1, 1));
  EXPECT_TRUE(Build().empty());
}

}  // namespace
}  // namespace mapp
