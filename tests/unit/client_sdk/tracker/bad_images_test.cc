// What cameras deliver when they do not work: the tracker may lose its place, but reports no false pose.
#include "mapp/client/orb_tracker.h"
#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>

namespace mapp {
namespace {

using tracker_test::Borrow;
using tracker_test::FirstRoomFrames;
using tracker_test::SynchronousOptions;

constexpr double kPoseToleranceM = 0.02;
constexpr size_t kBadFrom = 6;  ///< frames before are good

class BadImagesTest : public ::testing::Test {
 protected:
  BadImagesTest() {
    auto tracker = OrbTracker::CreateRgbd(FirstRoomFrames().camera, SynchronousOptions());
    EXPECT_TRUE(tracker.ok()) << tracker.status();
    tracker_ = *std::move(tracker);
  }

  /// Tracks frame i after `change` has been at its images.
  TrackingResult Track(
      size_t i, const std::function<void(SequenceFrame&)>& change = [](SequenceFrame&) {}) {
    SequenceFrame frame = FirstRoomFrames().frames[i];
    change(frame);
    const auto result = tracker_->Track(Borrow(frame));
    EXPECT_TRUE(result.ok()) << result.status();
    return *result;
  }
  void TrackGoodOnes() {
    for (size_t i = 0; i < kBadFrom; ++i) ASSERT_EQ(Track(i).state, TrackingState::kTracking);
  }
  static double ErrorM(const TrackingResult& result, size_t i) {
    const auto& T_world_camera = FirstRoomFrames().T_world_camera;
    return Distance(result.T_session_camera, T_world_camera.front().Inverse() * T_world_camera[i]);
  }
  void ExpectFindsItself(size_t i) {
    const TrackingResult result = Track(i);
    EXPECT_EQ(result.state, TrackingState::kTracking);
    EXPECT_LT(ErrorM(result, i), kPoseToleranceM);
  }
  /// Depth in another unit than metres.
  void ExpectNoMapOfDepths(float factor) {
    for (size_t i = 0; i < kBadFrom; ++i) {
      const TrackingResult result = Track(i, [factor](SequenceFrame& frame) {
        for (float& depth_m : frame.depth_m.pixels) depth_m *= factor;
      });
      EXPECT_EQ(result.state, TrackingState::kNotStarted);
    }
    EXPECT_TRUE(tracker_->TakeKeyframes().empty());
  }

  std::unique_ptr<OrbTracker> tracker_;
};

/// Mean over a square of `reach` pixels each way.
void Blur(GrayImage& image, int reach) {
  const GrayImage sharp = image;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      int sum = 0, count = 0;
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, image.height - 1); ++v) {
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, image.width - 1); ++u, ++count) {
          sum += sharp.at(u, v);
        }
      }
      image.at(x, y) = static_cast<uint8_t>(sum / count);
    }
  }
}

TEST_F(BadImagesTest, DepthInMillimetresMakesNoMap) { ExpectNoMapOfDepths(1000); }

TEST_F(BadImagesTest, DepthInKilometresMakesNoMap) { ExpectNoMapOfDepths(0.001F); }

TEST_F(BadImagesTest, AnOverExposedImageIsLost) {
  TrackGoodOnes();
  const TrackingResult result = Track(kBadFrom, [](SequenceFrame& frame) {
    std::fill(frame.gray.pixels.begin(), frame.gray.pixels.end(), uint8_t{255});
  });
  EXPECT_EQ(result.state, TrackingState::kLost);
  ExpectFindsItself(kBadFrom + 1);
}

TEST_F(BadImagesTest, ABlurredImageIsLostOrInItsPlace) {
  TrackGoodOnes();
  for (const int reach : {1, 3, 8}) {
    const size_t i = kBadFrom + static_cast<size_t>(reach);
    const TrackingResult result = Track(i, [&](SequenceFrame& frame) { Blur(frame.gray, reach); });
    if (result.state == TrackingState::kLost) continue;
    EXPECT_LT(ErrorM(result, i), 0.1) << "blurred over " << 2 * reach + 1 << " px";
  }
  ExpectFindsItself(kBadFrom + 9);
}

TEST_F(BadImagesTest, AFrozenImageStaysWhereItIs) {
  TrackGoodOnes();
  const int64_t last_ns = FirstRoomFrames().frames[kBadFrom].stamp_ns;
  for (int repeat = 0; repeat < 20; ++repeat) {
    const TrackingResult result = Track(kBadFrom, [&](SequenceFrame& frame) { frame.stamp_ns = last_ns + repeat; });
    ASSERT_EQ(result.state, TrackingState::kTracking);
    EXPECT_LT(ErrorM(result, kBadFrom), kPoseToleranceM);
  }
}

TEST_F(BadImagesTest, DroppedFramesAreCaughtUpWith) {
  TrackGoodOnes();
  const size_t num_frames = FirstRoomFrames().frames.size();
  for (size_t i = kBadFrom + 6; i + 1 < num_frames; i += 6) {
    const TrackingResult result = Track(i);
    if (result.state != TrackingState::kTracking) continue;
    EXPECT_LT(ErrorM(result, i), kPoseToleranceM) << "frame " << i;
  }
  ExpectFindsItself(num_frames - 1);
}

}  // namespace
}  // namespace mapp
