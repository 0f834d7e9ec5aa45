// What users get wrong, or the world: each a clear line that names the culprit, the right exit code, and no crash.

#include "tests/e2e/service_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <cstring>
#include <sys/mount.h>

namespace mapp {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

constexpr char kCalibration[] =
    "%YAML:1.0\nresolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [525, 525, 320, 240]\n"
    "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\ndepth_scale: 1000\n";

class BadInputTest : public ServiceTest {
 protected:
  /// A TUM RGB-D folder whose only frame is no image.
  std::string MakeBrokenSequence() const {
    const std::filesystem::path sequence = folder().path() / "broken";
    WriteFile(sequence / "camera.yaml", kCalibration);
    WriteFile(sequence / "rgb.txt", "0.0 rgb/0.jpg\n");
    WriteFile(sequence / "depth.txt", "0.0 depth/0.png\n");
    WriteFile(sequence / "rgb" / "0.jpg", "this is no JPEG");
    WriteFile(sequence / "depth" / "0.png", "this is no PNG");
    return sequence.string();
  }
  std::string ReplayFailure(const std::string& sequence) { return ExpectFailure(ReplayArguments(sequence, "device")); }
};

TEST_F(BadInputTest, SequenceFolderThatIsNotThere) {
  StartServer();
  EXPECT_THAT(ReplayFailure("/no/such/folder"), HasSubstr("/no/such/folder"));
}

TEST_F(BadInputTest, SequenceFolderWithoutImages) {
  StartServer();
  const std::filesystem::path sequence = folder().path() / "empty";
  WriteFile(sequence / "camera.yaml", kCalibration);
  WriteFile(sequence / "rgb.txt", "# nothing\n");
  WriteFile(sequence / "depth.txt", "# nothing\n");
  EXPECT_THAT(ReplayFailure(sequence.string()), HasSubstr("rgb.txt"));
}

TEST_F(BadInputTest, BrokenImageEndsTheReplayAndClosesTheSession) {
  StartServer();
  EXPECT_THAT(ReplayFailure(MakeBrokenSequence()), HasSubstr("0.jpg"));
  const Finished sessions = RunMapp({"sessions", "list", "--server", server().address(), "--json"});
  EXPECT_GT(JsonNumber(sessions.out, "closed_unix_ns").value_or(0), 0) << sessions.out;
  EXPECT_EQ(JsonNumber(sessions.out, "num_keyframes"), 0.0);
}

TEST_F(BadInputTest, CameraWithZeroFocalLength) {
  StartServer();
  const std::string sequence = MakeBrokenSequence();
  std::string calibration = kCalibration;
  calibration.replace(calibration.find("[525"), 4, "[0");
  WriteFile(std::filesystem::path(sequence) / "camera.yaml", calibration);
  EXPECT_THAT(ReplayFailure(sequence), AllOf(HasSubstr("camera.yaml"), HasSubstr("intrinsics")));
}

TEST_F(BadInputTest, ImageOfASingleCameraThatIsNone) {
  StartServer();
  const std::string sequence = MakeBrokenSequence();
  std::filesystem::remove(std::filesystem::path(sequence) / "depth.txt");
  EXPECT_THAT(ReplayFailure(sequence), AllOf(HasSubstr("frame 0"), HasSubstr("0.jpg")));
}

TEST_F(BadInputTest, MapThatDoesNotExist) {
  StartServer();
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"maps", "show", "nope"},
                                             {"maps", "delete", "--yes", "nope"},
                                             {"sessions", "list", "--map", "nope"},
                                             {"export", "--map", "nope", "--out", folder().File("nope.ply")},
                                             {"render", "--map", "nope", "--out", folder().File("nope.png")}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--server", server().address()});
    EXPECT_THAT(ExpectFailure(arguments), HasSubstr("nope"));
  }
  EXPECT_FALSE(std::filesystem::exists(folder().File("nope.ply")));
}

TEST_F(BadInputTest, NoServer) {
  EXPECT_THAT(ExpectFailure({"maps", "list", "--server", "127.0.0.1:1"}), HasSubstr("127.0.0.1:1"));
}

TEST_F(BadInputTest, DeletingAMapAsksFirst) {
  StartServer();
  // Opens the session that makes the map, then fails.
  ReplayFailure(MakeBrokenSequence());
  EXPECT_THAT(ExpectFailure({"maps", "delete", "place", "--server", server().address()}), HasSubstr("--yes"));
  EXPECT_EQ(RunMapp({"maps", "show", "place", "--server", server().address()}).exit_code, 0);
  EXPECT_EQ(RunMapp({"maps", "delete", "place", "--yes", "--server", server().address()}).exit_code, 0);
  ExpectFailure({"maps", "show", "place", "--server", server().address()});
}

struct WrongUsage {
  std::string name;
  std::vector<std::string> arguments;
  std::string culprit;  ///< what the error names
};

class WrongUsageTest : public testing::TestWithParam<WrongUsage> {};

TEST_P(WrongUsageTest, ExitsWith2AndNamesTheCulprit) {
  const Finished finished = RunMapp(GetParam().arguments);
  EXPECT_EQ(finished.exit_code, 2) << finished.err;
  EXPECT_THAT(finished.err, AllOf(StartsWith("mapp: "), HasSubstr(GetParam().culprit)));
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
}

INSTANTIATE_TEST_SUITE_P(
    CommandLine, WrongUsageTest,
    testing::Values(
        WrongUsage{"NoSubcommand", {}, "subcommand"}, WrongUsage{"UnknownSubcommand", {"fly"}, "fly"},
        WrongUsage{"UnknownOption", {"maps", "list", "--fast"}, "--fast"},
        WrongUsage{"NoMap", {"replay", "--device", "d", "sim:room/0"}, "--map"},
        WrongUsage{"NoSequence", {"replay", "--device", "d", "--map", "m"}, "sequence"},
        WrongUsage{
            "UnknownPolicy", {"replay", "--device", "d", "--map", "m", "--policy", "some", "sim:room/0"}, "--policy"},
        WrongUsage{"UnknownSampler",
                   {"replay", "--device", "d", "--map", "m", "--sampler", "best", "sim:room/0"},
                   "--sampler: best is not one of depth_sketch, uniform"},
        WrongUsage{
            "NarrowedSharing", {"replay", "--device", "d", "--map", "m", "--alpha", "0.9", "sim:room/0"}, "--alpha"},
        WrongUsage{"UnknownFormat",
                   {"export", "--map", "m", "--out", "x", "--format", "obj"},
                   "--format: obj is not one of ply, tum"},
        WrongUsage{"OneAlignByFile",
                   {"replay", "--device", "d", "--map", "m", "sim:room/0", "--align-by", "truth.txt"},
                   "--align-by"},
        WrongUsage{"OneTogetherWithFile",
                   {"replay", "--device", "d", "--map", "m", "sim:room/0", "--together-with", "truth.txt"},
                   "--together-with"},
        WrongUsage{"UnknownSimulation", {"replay", "--device", "d", "--map", "m", "sim:cellar/0"}, "sim:cellar/0"},
        WrongUsage{"BackupToNowhere", {"backup", "--db", "maps.db"}, "--to"},
        WrongUsage{"BackupThatKeepsNone", {"backup", "--to", "x", "--keep", "0"}, "--keep"},
        WrongUsage{"RestoreToNowhere", {"restore", "backup.db"}, "--db"},
        WrongUsage{"PictureTooSmall", {"render", "--map", "m", "--out", "x.png", "--width", "3"}, "--width"}),
    [](const auto& suite_info) { return suite_info.param.name; });

class BadServerTest : public testing::Test {
 protected:
  /// Runs mapp-server, which must refuse to start: exit code 1 and one line on stderr that says why.
  std::string ExpectRefusal(const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {MAPP_SERVER_BINARY};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Finished finished = RunCommand(command, std::chrono::seconds(30));
    EXPECT_EQ(finished.exit_code, 1) << finished.err;
    const size_t last_line = finished.err.rfind('\n', finished.err.size() - 2) + 1;
    EXPECT_THAT(finished.err.substr(last_line), StartsWith("mapp-server: ")) << finished.err;
    return finished.err.substr(last_line);
  }
  TempFolder folder_;
};

TEST_F(BadServerTest, UnreadableDatabaseIsNamedAndLeftAlone) {
  const std::string database = folder_.File("garbage.db");
  const std::string garbage(100'000, 'x');
  WriteFile(database, garbage);
  EXPECT_THAT(ExpectRefusal({"--db", database, "--listen", "127.0.0.1:0"}), HasSubstr("garbage.db"));
  EXPECT_EQ(ReadFile(database), garbage);
}

TEST_F(BadServerTest, PortInUseIsNamed) {
  const ServerProcess first(folder_.File("first.db"), folder_);
  EXPECT_THAT(ExpectRefusal({"--db", folder_.File("second.db"), "--listen", first.address()}),
              HasSubstr(first.address()));
}

/// A file system of 2 MB for as long as it lives.
class TinyDisk {
 public:
  explicit TinyDisk(const std::string& folder) : folder_(folder) {
    std::filesystem::create_directories(folder);
    mounted_ = mount("tmpfs", folder.c_str(), "tmpfs", 0, "size=2m") == 0;
    error_ = mounted_ ? 0 : errno;
  }
  ~TinyDisk() {
    if (mounted_) umount2(folder_.c_str(), MNT_DETACH);
  }
  bool mounted() const { return mounted_; }
  std::string error() const { return std::strerror(error_); }

 private:
  std::string folder_;
  bool mounted_ = false;
  int error_ = 0;
};

class FullDiskTest : public ServiceTest {};

TEST_F(FullDiskTest, ClientIsToldAndTheServerStaysUp) {
  TempFolder disk_folder;
  const TinyDisk disk(disk_folder.File("disk"));
  if (!disk.mounted()) GTEST_SKIP() << "needs a file system of its own: " << disk.error();
  ServerProcess tiny(disk_folder.File("disk/map.db"), folder());
  const std::string error =
      ExpectFailure({"replay", "--server", tiny.address(), "--map", "place", "--device", "device", "sim:room/0"});
  EXPECT_THAT(error, testing::ContainsRegex("disk|full|space")) << error;
  EXPECT_TRUE(tiny.IsRunning());
  const Finished maps = RunMapp({"maps", "list", "--server", tiny.address()});
  EXPECT_EQ(maps.exit_code, 0) << maps.err;
  EXPECT_THAT(maps.out, HasSubstr("place")) << "what was stored is still read";
}

}  // namespace
}  // namespace mapp
