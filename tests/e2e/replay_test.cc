// The main job with the real executables: a device maps a place and leaves; the server is killed and started again; a
// second device comes later from an unknown start and is aligned, uploads what is fresh and localises on the map.

#include "tests/e2e/service_fixture.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

/// What a second session must reach.
struct SecondSessionBars {
  double max_aligned_at_keyframe = 0;
  double max_ate_joint_m = 0;
  double min_shared_frame_ratio = 0;
  double max_upload_share = 0;
};

void ExpectReaches(const SecondSessionBars& bars, const Replayed& replayed) {
  const std::optional<double> aligned_at = JsonNumber(replayed.json, "aligned_at_keyframe");
  ASSERT_TRUE(aligned_at.has_value()) << "never aligned: " << replayed.json;
  EXPECT_LE(*aligned_at, bars.max_aligned_at_keyframe);
  ASSERT_TRUE(JsonNumber(replayed.json, "ate_joint_m").has_value()) << replayed.json;
  EXPECT_LE(replayed.Number("ate_joint_m"), bars.max_ate_joint_m);
  EXPECT_GE(replayed.Number("frames_on_shared_map"), bars.min_shared_frame_ratio * replayed.Number("frames"));
  EXPECT_LE(replayed.Number("upload_share"), bars.max_upload_share);
}

void ExpectMapsThePlace(const Replayed& first, double max_ate_m) {
  EXPECT_EQ(JsonNumber(first.json, "aligned_at_keyframe"), 0.0) << "it founds the map";
  EXPECT_GE(first.Number("frames_tracked"), 0.95 * first.Number("frames"));
  ASSERT_TRUE(JsonNumber(first.json, "ate_m").has_value()) << first.json;
  EXPECT_LE(first.Number("ate_m"), max_ate_m);
  EXPECT_EQ(first.Number("keyframes_uploaded") + first.Number("keyframes_skipped"), first.Number("keyframes"));
}

class RoomReplayTest : public ServiceTest {};

TEST_F(RoomReplayTest, SecondDeviceJoinsTheMapAfterTheServerWasKilled) {
  StartServer();
  const Replayed first = Replay("sim:room/0", "first");
  ExpectMapsThePlace(first, 0.05);

  KillAndRestartServer();
  std::vector<std::string> judged = AlignBy(first);
  judged.push_back("--together-with");
  judged.insert(judged.end(), judged.begin() + 1, judged.begin() + 3);
  const Replayed second = Replay("sim:room/1", "second", judged);
  ExpectReaches(
      {.max_aligned_at_keyframe = 15, .max_ate_joint_m = 0.06, .min_shared_frame_ratio = 0.1, .max_upload_share = 0.9},
      second);
  EXPECT_LE(second.Number("ate_together_m"), 0.06);
  EXPECT_GT(second.Number("ate_together_m"), 0);
  EXPECT_GT(second.Number("shared_map_requests"), 0);
  EXPECT_LE(second.Number("query_bytes"), 64);
  EXPECT_LE(second.Number("response_bytes_mean"), 200);

  const std::string png = folder().File("map.png");
  const Finished rendered = RunMapp({"render", "--server", server().address(), "--map", "place", "--out", png,
                                     "--frames", folder().File("first.frames"), folder().File("second.frames")});
  EXPECT_EQ(rendered.exit_code, 0) << rendered.err;
  EXPECT_EQ(ReadFile(png).substr(1, 3), "PNG");
  EXPECT_EQ(server().Stop(), 0);
}

class TileCacheReplayTest : public ServiceTest {
 protected:
  static std::string Visit(int user) {
    return "sim:garage:users=3,path=12,seed=1,sensor=rgbd,rate=10,routes=1,camera=d455-640/" + std::to_string(user);
  }
};

TEST_F(TileCacheReplayTest, TheSecondDriveDownloadsWhatHasChangedSinceTheFirst) {
  StartServer();
  Replay(Visit(0), "mapper", {"--level", "features"});
  const std::vector<std::string> cached = {"--level", "features", "--tile-cache", folder().File("tiles")};
  const Replayed first = Replay(Visit(1), "first", cached);
  EXPECT_EQ(first.Number("cached_tiles"), 0);
  EXPECT_GT(first.Number("frames_on_shared_map"), 0.5 * first.Number("frames"));
  KillAndRestartServer();
  const Replayed second = Replay(Visit(2), "second", cached);
  EXPECT_GT(second.Number("frames_on_shared_map"), 0.5 * second.Number("frames"));
  EXPECT_GT(second.Number("cached_tiles"), 0);
  EXPECT_LT(second.Number("download_bytes"), 0.8 * first.Number("download_bytes"));
}

TEST_F(TileCacheReplayTest, AFolderThatCannotBeWrittenIsNamed) {
  StartServer();
  const std::string in_the_way = folder().File("map.db");
  const std::string error = ExpectFailure({"replay", "--server", server().address(), "--map", "m", "--device", "d",
                                           "--tile-cache", in_the_way, "--level", "features", Visit(0)});
  EXPECT_NE(error.find("tile_cache.folder: " + in_the_way), std::string::npos) << error;
}

class KitchenReplayTest : public ServiceTest {
 protected:
  void SetUp() override {
    if (!DataFolder("redkitchen")) GTEST_SKIP() << "recorded data redkitchen is not here";
  }
  static std::string Session(const std::string& name) { return *DataFolder("redkitchen") + "/" + name; }
  /// The first device in, and the server killed behind it.
  Replayed MapTheKitchen() {
    StartServer();
    const Replayed first = Replay(Session("a"), "first");
    ExpectMapsThePlace(first, 0.05);
    KillAndRestartServer();
    return first;
  }
};

TEST_F(KitchenReplayTest, DeviceThatSeesMuchAgainLocalisesOnTheMap) {
  const Replayed first = MapTheKitchen();
  const Replayed second = Replay(Session("c"), "second", AlignBy(first));
  ExpectReaches(
      {.max_aligned_at_keyframe = 10, .max_ate_joint_m = 0.06, .min_shared_frame_ratio = 0.5, .max_upload_share = 0.4},
      second);
  EXPECT_LE(second.Number("query_bytes"), 64);
  EXPECT_LE(second.Number("response_bytes_mean"), 200);
}

TEST_F(KitchenReplayTest, DeviceThatOverlapsInPartExtendsTheMap) {
  const Replayed first = MapTheKitchen();
  const Replayed second = Replay(Session("b"), "second", AlignBy(first));
  // Where it starts, b sees what a has not seen: when it is aligned, and how much is shared, depends on the place.
  ExpectReaches(
      {.max_aligned_at_keyframe = 100, .max_ate_joint_m = 0.08, .min_shared_frame_ratio = 0, .max_upload_share = 1},
      second);
}

TEST_F(KitchenReplayTest, SessionFromAnotherPlaceIsNeverMerged) {
  MapTheKitchen();
  const Replayed stranger = Replay("sim:room/0", "stranger");
  EXPECT_FALSE(JsonNumber(stranger.json, "aligned_at_keyframe").has_value()) << stranger.json;
  EXPECT_EQ(stranger.Number("frames_on_shared_map"), 0);
  EXPECT_EQ(stranger.Number("keyframes_uploaded"), stranger.Number("keyframes")) << "kept as a fragment";
}

}  // namespace
}  // namespace mapp
