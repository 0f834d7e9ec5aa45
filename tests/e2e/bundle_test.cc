// A map as a bundle: made on one server, served by another, to a device that was never here.

#include "tests/e2e/service_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

namespace mapp {
namespace {

using testing::HasSubstr;

constexpr std::chrono::seconds kSecondReplayTimeout(600);
constexpr int kNumKills = 6;

class BundleTest : public ServiceTest {
 protected:
  /// The room as the first device maps it, in the file bundle().
  Replayed ExportTheRoom() {
    StartServer();
    Replayed first = Replay("sim:room/0", "first");
    const Finished exported =
        RunMapp({"maps", "export", "place", "--bundle", bundle(), "--json", "--server", server().address()});
    EXPECT_EQ(exported.exit_code, 0) << exported.err;
    EXPECT_EQ(JsonNumber(exported.out, "num_frames"), first.Number("keyframes_uploaded"));
    server().Kill();
    return first;
  }
  std::string bundle() const { return folder().File("room.mappbundle"); }
  std::string other_database() const { return other_folder_.File("other.db"); }
  ServerProcess OtherServer() const { return {other_database(), other_folder_}; }

  TempFolder other_folder_;
};

TEST_F(BundleTest, DeviceLocalisesInAMapFromAnotherServer) {
  const Replayed first = ExportTheRoom();
  ServerProcess other = OtherServer();
  const Finished imported = RunMapp({"maps", "import", "--bundle", bundle(), "--server", other.address()});
  ASSERT_EQ(imported.exit_code, 0) << imported.err;
  EXPECT_THAT(imported.out, HasSubstr("imported place from"));
  EXPECT_THAT(ExpectFailure({"maps", "import", "--bundle", bundle(), "--server", other.address()}),
              HasSubstr("map \"place\" is there already: import the bundle under another name with --as"));

  std::vector<std::string> arguments = ReplayArguments("sim:room/1", "second", AlignBy(first));
  *(std::ranges::find(arguments, "--server") + 1) = other.address();
  arguments.insert(arguments.begin(), MappBinary());
  const Finished replayed = RunCommand(arguments, kSecondReplayTimeout);
  ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
  const Replayed second = CollectReplay("second", replayed.exit_code, replayed.err);
  ASSERT_TRUE(JsonNumber(second.json, "aligned_at_keyframe").has_value()) << second.json;
  EXPECT_LE(second.Number("aligned_at_keyframe"), 15);
  EXPECT_LE(second.Number("ate_joint_m"), 0.06);
  EXPECT_GE(second.Number("frames_on_shared_map"), 0.1 * second.Number("frames"));
  EXPECT_GT(second.Number("shared_map_requests"), 0);
  EXPECT_EQ(other.Stop(), 0);
  const Finished verified = RunMapp({"verify", "--db", other_database()});
  EXPECT_EQ(verified.exit_code, 0) << verified.out;
}

TEST_F(BundleTest, KilledServerHasTheWholeMapOrNothing) {
  const Replayed first = ExportTheRoom();
  for (int i = 0; i < kNumKills; ++i) {
    const std::string name = "map-" + std::to_string(i);
    ServerProcess other = OtherServer();
    Process import({MappBinary(), "maps", "import", "--bundle", bundle(), "--as", name, "--server", other.address()},
                   other_folder_.path());
    std::this_thread::sleep_for(std::chrono::milliseconds(20 * i));
    other.Kill();
    const std::optional<int> exit_code = import.Wait(std::chrono::seconds(60));
    ASSERT_TRUE(exit_code.has_value());

    ServerProcess again = OtherServer();
    const Finished shown = RunMapp({"maps", "show", name, "--json", "--server", again.address()});
    if (*exit_code == 0) {
      EXPECT_EQ(shown.exit_code, 0) << "an import that was acknowledged is gone";
    }
    if (shown.exit_code == 0) {
      EXPECT_EQ(JsonNumber(shown.out, "num_frames"), first.Number("keyframes_uploaded"));
    }
    EXPECT_EQ(again.Stop(), 0);
    const Finished verified = RunMapp({"verify", "--db", other_database()});
    EXPECT_EQ(verified.exit_code, 0) << verified.out;
  }
}

TEST_F(BundleTest, FileThatIsNoWholeBundleIsRefusedInALine) {
  ExportTheRoom();
  const std::string whole = ReadFile(bundle());
  WriteFile(bundle(), whole.substr(0, whole.size() / 3));
  ServerProcess other = OtherServer();
  EXPECT_THAT(ExpectFailure({"maps", "import", "--bundle", bundle(), "--server", other.address()}),
              HasSubstr("room.mappbundle: the bundle is cut short, it ends after"));
  EXPECT_THAT(ExpectFailure({"maps", "import", "--bundle", bundle(), "--dry-run"}), HasSubstr("cut short"));
  const Finished listed = RunMapp({"maps", "list", "--json", "--server", other.address()});
  EXPECT_THAT(listed.out, testing::Not(HasSubstr("place")));
}

}  // namespace
}  // namespace mapp
