#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/shared_localizer.h"
#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace mapp::tracker {
namespace {

using tracker_test::Borrow;
using tracker_test::FirstRoomFrames;
using tracker_test::MakeSharedMap;
using tracker_test::SynchronousOptions;

/// A shared map of the room, tried by a device that stands before it.
class SharedAdoptionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto builder = MakeRgbdFrameBuilder(FirstRoomFrames().camera, options_);
    ASSERT_TRUE(builder.ok()) << builder.status();
    builder_ = *std::move(builder);
    relocalizer_ = std::make_unique<Relocalizer>(builder_->camera(), 40);
    localizer_ = std::make_unique<SharedLocalizer>(shared_, builder_->camera(), options_);

    auto mapper = OrbTracker::CreateRgbd(FirstRoomFrames().camera, options_);
    ASSERT_TRUE(mapper.ok()) << mapper.status();
    for (const SequenceFrame& frame : FirstRoomFrames().frames) ASSERT_TRUE((*mapper)->Track(Borrow(frame)).ok());
    localizer_->Take(MakeSharedMap((*mapper)->TakeKeyframes(), FirstRoomFrames().camera, Pose3(), 1, 1000));
  }

  /// Frame i, whose pose the device thinks to be `shift_m` off its true one.
  SharedLocalizer::Outcome Localize(size_t i, double shift_m) {
    const auto& T_world_camera = FirstRoomFrames().T_world_camera;
    const Pose3 truth = T_world_camera.front().Inverse() * T_world_camera[i];
    const Pose3 guess = Pose3(Eigen::Quaterniond::Identity(), {shift_m, 0, 0}) * truth;
    const auto frame = builder_->Build(Borrow(FirstRoomFrames().frames[i]));
    EXPECT_TRUE(frame.ok()) << frame.status();
    return localizer_->Localize(**frame, guess, PoseBound::AroundGuess(guess), *relocalizer_);
  }

  const OrbTrackerOptions options_ = SynchronousOptions();
  std::unique_ptr<FrameBuilder> builder_;
  SharedSessionMap shared_;
  std::unique_ptr<Relocalizer> relocalizer_;
  std::unique_ptr<SharedLocalizer> localizer_;
};

TEST_F(SharedAdoptionTest, TheThirdFrameThatAgreesAdopts) {
  for (size_t i = 0; i < 2; ++i) {
    const auto outcome = Localize(i, 0.06);
    EXPECT_TRUE(outcome.undecided);
    EXPECT_FALSE(outcome.localized);
  }
  const auto outcome = Localize(2, 0.06);
  EXPECT_TRUE(outcome.localized && outcome.newly_adopted);
  EXPECT_TRUE(Localize(3, 0.06).localized);
}

TEST_F(SharedAdoptionTest, FramesThatDisagreeDoNot) {
  int num_undecided = 0;
  SharedLocalizer::Outcome outcome;
  for (size_t i = 0; i < 20; ++i) {
    // Each frame puts the device's own pose 5 cm further off than the one before.
    outcome = Localize(i, 0.05 * static_cast<double>(i % 4));
    ASSERT_FALSE(outcome.newly_adopted) << "frame " << i;
    num_undecided += outcome.undecided ? 1 : 0;
  }
  EXPECT_GE(num_undecided, 3);
  EXPECT_FALSE(outcome.undecided || outcome.localized) << "in the end the participant is told that it fails";
  EXPECT_GE(outcome.num_matches, 75);
}

}  // namespace
}  // namespace mapp::tracker
