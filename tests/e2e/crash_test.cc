// The server is killed by SIGKILL at random moments while devices upload: nothing acknowledged is lost or doubled.

#include "mapp/base/rng.h"
#include "tests/e2e/service_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <iostream>
#include <map>
#include <sstream>

namespace mapp {
namespace {

using std::chrono::milliseconds;

constexpr int kNumKills = 12;
/// In one session, so that it comes to its end.
constexpr int kMaxKillsPerSession = 6;
constexpr std::chrono::minutes kReplayTimeout(5);
constexpr uint64_t kSeed = 20240731;

class CrashTest : public ServiceTest {
 protected:
  /// The session exists on the server: from here on every call is safe to repeat.
  bool HasSession(const std::string& device) {
    const Finished list = RunMapp({"sessions", "list", "--server", server().address(), "--json"});
    return list.out.find(fmt::format("\"device\": \"{}\"", device)) != std::string::npos;
  }

  /// Replays while killing the server at random moments; returns the number of kills.
  int ReplayUnderFire(const std::string& sequence, const std::string& device, Rng& rng) {
    std::vector<std::string> command = ReplayArguments(sequence, device, {"--policy", "upload_all"});
    command.insert(command.begin(), MappBinary());
    Process replay(command, folder().path());
    std::optional<int> exit_code;
    while (!exit_code && !HasSession(device)) exit_code = replay.Wait(milliseconds(20));
    int num_kills = 0;
    for (; !exit_code && num_kills < kMaxKillsPerSession; ++num_kills) {
      exit_code = replay.Wait(milliseconds(100 + rng.Below(900)));
      if (exit_code) break;
      KillAndRestartServer();
    }
    if (!exit_code) exit_code = replay.Wait(kReplayTimeout);
    EXPECT_EQ(exit_code, 0) << replay.StandardError();
    return num_kills;
  }

  /// How often each time stamp stands in the file that `mapp export` wrote for a session. Empty when there is none.
  std::map<std::string, int> ExportedStamps(uint64_t session_id) {
    const std::string out = folder().File("export");
    const Finished exported =
        RunMapp({"export", "--server", server().address(), "--map", "place", "--format", "tum", "--out", out});
    EXPECT_EQ(exported.exit_code, 0) << exported.err;
    std::istringstream lines(ReadFile(fmt::format("{}/session_{}.txt", out, session_id)));
    std::map<std::string, int> stamps;
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with('#')) ++stamps[line.substr(0, line.find(' '))];
    }
    return stamps;
  }
};

TEST_F(CrashTest, EveryAcknowledgedKeyframeIsThereExactlyOnce) {
  StartServer();
  Rng rng(kSeed);
  int num_kills = 0;
  std::vector<std::string> devices;
  // One replay may be over before enough kills have hit it.
  for (int session = 0; num_kills < kNumKills; ++session) {
    ASSERT_LT(session, 20) << "only " << num_kills << " kills";
    devices.push_back(fmt::format("device{}", session));
    num_kills += ReplayUnderFire(fmt::format("sim:room/{}", session % 2), devices.back(), rng);
  }
  std::cout << num_kills << " kills in " << devices.size() << " sessions\n";

  for (const std::string& device : devices) {
    const Replayed replayed = CollectReplay(device, 0, "");
    const double num_uploaded = replayed.Number("keyframes_uploaded");
    EXPECT_GT(num_uploaded, 0) << device;
    EXPECT_EQ(num_uploaded, replayed.Number("keyframes")) << device << ": the client must go on after each kill";
    ASSERT_TRUE(JsonNumber(replayed.json, "aligned_at_keyframe").has_value()) << device;

    const auto stamps = ExportedStamps(static_cast<uint64_t>(replayed.Number("session_id")));
    EXPECT_EQ(static_cast<double>(stamps.size()), num_uploaded) << device << ": none is missing";
    for (const auto& [stamp, count] : stamps) EXPECT_EQ(count, 1) << device << ": doubled at " << stamp;
  }
  EXPECT_EQ(server().Stop(), 0);
}

}  // namespace
}  // namespace mapp
