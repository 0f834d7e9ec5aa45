// Recorded flights and drives with a single camera, which tells no lengths: how they come into one map, and what a map
// that such a device has founded is.

#include "tests/e2e/service_fixture.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

/// A pose reported in the map that is wrong by more than this is a lie.
constexpr double kMaxErrorM = 1;

class SingleCameraTest : public ServiceTest {
 protected:
  void SetUp() override {
    for (const char* name : {"euroc_mh05", "euroc_v101", "uzh_parking"}) {
      if (!DataFolder(name)) GTEST_SKIP() << "recorded data " << name << " is not here";
    }
    StartServer();
  }
  static std::string Recorded(const std::string& name) { return *DataFolder(name); }
  std::string Maps() {
    const Finished maps = RunMapp({"maps", "list", "--server", server().address(), "--json"});
    EXPECT_EQ(maps.exit_code, 0) << maps.err;
    return maps.out;
  }
  bool ScaleIsUnknown() { return Maps().find("\"scale_unknown\": true") != std::string::npos; }

  /// Two flights with a piece of their way in common, the second in the first one's map.
  void ExpectOneMap(const std::string& name, double max_ate_joint_m) {
    const Replayed first = Replay(Recorded(name) + "/a", "first");
    ASSERT_EQ(first.exit_code, 0) << first.err;
    EXPECT_EQ(JsonNumber(first.json, "aligned_at_keyframe"), 0.0) << "it founds the map";
    EXPECT_TRUE(ScaleIsUnknown()) << Maps();
    const Replayed second = Replay(Recorded(name) + "/b", "second", AlignBy(first));
    ASSERT_EQ(second.exit_code, 0) << second.err;
    ASSERT_TRUE(JsonNumber(second.json, "aligned_at_keyframe").has_value()) << second.json;
    ASSERT_TRUE(JsonNumber(second.json, "ate_joint_m").has_value()) << second.json;
    EXPECT_LE(second.Number("ate_joint_m"), max_ate_joint_m);
    EXPECT_LE(second.Number("max_joint_error_m"), kMaxErrorM);
    EXPECT_EQ(second.Number("frames_aligned"), second.Number("frames_tracked"));
    EXPECT_GE(second.Number("frames_tracked"), 0.95 * second.Number("frames"));
    EXPECT_TRUE(ScaleIsUnknown()) << Maps();
  }
};

TEST_F(SingleCameraTest, TwoFlightsAreOneMapOfUnknownScale) { ExpectOneMap("euroc_mh05", 0.25); }

TEST_F(SingleCameraTest, TwoDrivesPastEqualCarsAreOneMapOfUnknownScale) { ExpectOneMap("uzh_parking", 0.5); }

TEST_F(SingleCameraTest, JoinsAMapInMetresAtItsScale) {
  const Replayed first = Replay(Recorded("euroc_v101") + "/keyframes_stereo", "first");
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const Replayed second = Replay(Recorded("euroc_v101") + "/clip_mono", "second", AlignBy(first));
  ASSERT_EQ(second.exit_code, 0) << second.err;
  ASSERT_TRUE(JsonNumber(second.json, "aligned_at_keyframe").has_value()) << second.json;
  EXPECT_LE(second.Number("ate_m"), 0.05) << "after the best rigid motion: its scale is the map's";
  EXPECT_LE(second.Number("ate_joint_m"), 0.08);
  EXPECT_LE(second.Number("max_joint_error_m"), 0.2);
  EXPECT_FALSE(ScaleIsUnknown()) << Maps();

  // Other places stay what they are.
  const Replayed stranger = Replay(Recorded("euroc_mh05") + "/b", "stranger");
  ASSERT_EQ(stranger.exit_code, 0) << stranger.err;
  EXPECT_FALSE(JsonNumber(stranger.json, "aligned_at_keyframe").has_value()) << stranger.json;
  EXPECT_EQ(stranger.Number("keyframes_uploaded"), stranger.Number("keyframes")) << "kept as a fragment";
}

TEST_F(SingleCameraTest, TheFirstInMetresGivesTheMapItsScale) {
  const Replayed first = Replay(Recorded("euroc_v101") + "/clip_mono", "first");
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_TRUE(ScaleIsUnknown()) << Maps();
  const Replayed second = Replay(Recorded("euroc_v101") + "/keyframes_stereo", "second");
  ASSERT_EQ(second.exit_code, 0) << second.err;
  ASSERT_TRUE(JsonNumber(second.json, "aligned_at_keyframe").has_value()) << second.json;
  EXPECT_FALSE(ScaleIsUnknown()) << Maps();
  EXPECT_LE(second.Number("ate_m"), 0.1) << "after the best rigid motion";
}

}  // namespace
}  // namespace mapp
