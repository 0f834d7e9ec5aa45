// The server is killed by SIGKILL at random moments while devices upload and operators are at work: nothing
// acknowledged is lost or doubled.

#include "cli/admin_client.h"
#include "mapp/base/mutex.h"
#include "mapp/base/rng.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/e2e/service_fixture.h"
#include "tests/e2e/uploader.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <iostream>
#include <map>
#include <semaphore>
#include <sstream>
#include <thread>

namespace mapp {
namespace {

using std::chrono::milliseconds;

/// Of the server under load: MAPP_KILLS, fewer unless told otherwise.
int NumKillsUnderLoad() {
  const char* const given = std::getenv("MAPP_KILLS");
  return given != nullptr ? std::atoi(given) : 60;
}

constexpr int kNumUploaders = 3;
/// So many keyframes of each uploader come between two kills at most, with every 4th feature, so that the map stays
/// small and operators come to their end now and then.
constexpr int kKeyframesAKill = 6;
constexpr int kFeatureStride = 4;
constexpr int kKillsAMap = 10;
/// How often the database is looked through while the server is dead.
constexpr int kKillsBetweenLooks = 20;
constexpr std::chrono::microseconds kLongestPause(250'000);
/// Every so many kills another one hits the next server at its start.
constexpr uint64_t kKillsAStart = 4;
constexpr std::chrono::microseconds kLongestStart(100'000);
constexpr std::chrono::minutes kAnswerTimeout(1);

constexpr int kNumKillsOfReplays = 4;
/// In one session, so that it comes to its end.
constexpr int kMaxKillsPerSession = 2;
constexpr std::chrono::minutes kReplayTimeout(5);
constexpr uint64_t kSeed = 20240731;

/// The server as those see it who must not take it for granted.
class ServedAddress {
 public:
  void Set(const std::string& address) {
    const MutexLock lock(mutex_);
    address_ = address;
    ++generation_;
    changed_.NotifyAll();
  }
  /// Waits for another server than the one of this generation, which it replaces; empty when there will be none.
  std::string Await(int* generation) {
    const MutexLock lock(mutex_);
    while (*generation == generation_) changed_.Wait(mutex_);
    *generation = generation_;
    return address_;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  int generation_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string address_ ABSL_GUARDED_BY(mutex_);
};

/// Asks one thing of the server, over and over; once the server has gone, of the next.
class Operator {
 public:
  /// `ask` may fail as long as the server has gone meanwhile.
  Operator(std::string name, ServedAddress& address, std::function<Status(AdminClient&)> ask)
      : name_(std::move(name)), address_(address), ask_(std::move(ask)), thread_([this] { Run(); }) {}
  /// After the address was set to nothing.
  void Join() {
    if (thread_.joinable()) thread_.join();
  }
  const std::string& name() const { return name_; }
  /// Waits until it has been answered once from now on.
  void ExpectAnswer() {
    while (answered_.try_acquire()) continue;
    EXPECT_TRUE(answered_.try_acquire_for(kAnswerTimeout)) << name_ << " is not answered";
  }
  int num_done() const { return num_done_; }
  int num_cut_short() const { return num_cut_short_; }

 private:
  void Run() {
    int generation = 0;
    for (;;) {
      const std::string address = address_.Await(&generation);
      if (address.empty()) return;
      AdminClient client(address);
      Status status;
      while ((status = ask_(client)).ok()) {
        ++num_done_;
        answered_.release();
      }
      EXPECT_TRUE(absl::IsUnavailable(status)) << name_ << ": " << status;
      ++num_cut_short_;
    }
  }

  const std::string name_;
  ServedAddress& address_;
  const std::function<Status(AdminClient&)> ask_;
  std::atomic<int> num_done_ = 0;
  std::atomic<int> num_cut_short_ = 0;
  std::counting_semaphore<> answered_{0};
  std::thread thread_;
};

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

TEST_F(CrashTest, DevicesGoOnAfterEachKill) {
  StartServer();
  Rng rng(kSeed);
  int num_kills = 0;
  std::vector<std::string> devices;
  // One replay may be over before enough kills have hit it.
  for (int session = 0; num_kills < kNumKillsOfReplays; ++session) {
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

/// Devices and operators, each on a thread of its own, and a server that is killed under them.
class CrashUnderLoadTest : public ServiceTest {
 protected:
  CrashUnderLoadTest() { std::filesystem::create_directory(backups_); }

  /// New devices in a new map; those before have done their work.
  void ChangeUploaders(const std::string& map) {
    StopUploaders();
    for (int i = 0; i < kNumUploaders; ++i) {
      auto uploader = std::make_unique<Uploader>(UploaderOptions{.server = server().address(),
                                                                 .map = map,
                                                                 .number = i,
                                                                 .keep_every = kFeatureStride,
                                                                 .waits = true,
                                                                 .acknowledged = &acknowledged_});
      const MutexLock lock(mutex_);
      uploaders_.push_back(std::move(uploader));
    }
    const MutexLock lock(mutex_);
    map_ = map;
  }
  void StopUploaders() {
    std::vector<std::unique_ptr<Uploader>> before;
    {
      const MutexLock lock(mutex_);
      before.swap(uploaders_);
    }
    for (const auto& uploader : before) {
      uploader->Stop();
      const MutexLock lock(mutex_);
      past_.push_back(uploader->acknowledged());
      num_retries_ += uploader->num_retries();
    }
  }
  std::string map() {
    const MutexLock lock(mutex_);
    return map_;
  }
  /// All that must be there from now on.
  std::vector<AcknowledgedKeyframes> Acknowledged() {
    const MutexLock lock(mutex_);
    std::vector<AcknowledgedKeyframes> all = past_;
    for (const auto& uploader : uploaders_) all.push_back(uploader->acknowledged());
    return all;
  }

  void StartOperators() {
    operators_.push_back(std::make_unique<Operator>("backup", address_, [this](AdminClient& client) {
      const std::vector<AcknowledgedKeyframes> acknowledged = Acknowledged();
      const std::string file = fmt::format("{}/{}.db", backups_, num_backups_++);
      BackupOptions backup;
      backup.to = file;
      MAPP_RETURN_IF_ERROR(client.BackUp(backup, {}).status());
      ExpectSound(file, acknowledged);
      std::filesystem::remove(file);
      return absl::OkStatus();
    }));
    operators_.push_back(std::make_unique<Operator>("optimize", address_, [this](AdminClient& client) {
      return client.OptimizeMap(map(), [](const MapOptimizationStep&) {}, {}).status();
    }));
    operators_.push_back(
        std::make_unique<Operator>("compact and verify", address_, [this](AdminClient& client) -> Status {
          const CompactionOrder order{.map_name = map(), .keep_revisions = 5, .keep_days = {}};
          MAPP_RETURN_IF_ERROR(client.CompactMap(order, [](const CompactionStep&) {}, {}).status());
          MAPP_ASSIGN_OR_RETURN(const VerifyReport report, client.Verify([](const VerifyProgress&) {}, {}));
          EXPECT_EQ(report.num_violations(), 0) << report.violations.at(0).check << report.violations.at(0).message;
          return absl::OkStatus();
        }));
  }

  /// By killing the server under them.
  void StopOperators() {
    address_.Set("");
    server().Kill();
    for (const auto& one : operators_) one->Join();
  }
  void TearDown() override {
    if (HasFatalFailure()) StopOperators();
  }

  /// The moment of a kill.
  static void SleepAtRandom(std::chrono::microseconds longest, Rng& rng) {
    std::this_thread::sleep_for(std::chrono::microseconds(rng.Below(static_cast<uint64_t>(longest.count()))));
  }
  /// While it takes up what the one before it has left.
  void KillStartingServer(Rng& rng) {
    Process starting({MappServerBinary(), "--db", database(), "--listen", "127.0.0.1:0"}, folder().path());
    SleepAtRandom(kLongestStart, rng);
    starting.Signal(SIGKILL);
    EXPECT_EQ(starting.Wait(kAnswerTimeout), 128 + SIGKILL) << starting.StandardError();
    ++num_kills_at_start_;
  }

  static void ExpectSound(const std::string& file, const std::vector<AcknowledgedKeyframes>& acknowledged) {
    SCOPED_TRACE(file);
    const Finished verified = RunMapp({"verify", "--db", file});
    EXPECT_EQ(verified.exit_code, 0) << verified.out << verified.err;
    const auto store = OpenSqliteMapStore(file, {.read_only = true});
    ASSERT_TRUE(store.ok()) << store.status();
    const auto reader = (*store)->Read().value();
    for (const AcknowledgedKeyframes& session : acknowledged) ExpectKeyframes(*reader, session);
  }

  const std::string backups_ = folder().File("backups");
  ServedAddress address_;
  std::counting_semaphore<> acknowledged_{0};
  std::vector<std::unique_ptr<Operator>> operators_;
  std::atomic<int> num_backups_ = 0;
  int num_kills_at_start_ = 0;
  Mutex mutex_;
  std::string map_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::unique_ptr<Uploader>> uploaders_ ABSL_GUARDED_BY(mutex_);
  uint64_t num_retries_ = 0;  ///< of the past ones
  std::vector<AcknowledgedKeyframes> past_ ABSL_GUARDED_BY(mutex_);
};

TEST_F(CrashUnderLoadTest, EveryAcknowledgedKeyframeIsThereExactlyOnce) {
  StartServer({"--backup-dir", backups_});
  Rng rng(kSeed);
  for (int kill = 0; kill < NumKillsUnderLoad(); ++kill) {
    if (kill % kKillsAMap == 0) ChangeUploaders(fmt::format("room {}", kill / kKillsAMap));
    if (kill == 0) StartOperators();
    address_.Set(server().address());
    while (acknowledged_.try_acquire()) continue;
    {
      const MutexLock lock(mutex_);
      for (const auto& uploader : uploaders_) uploader->Allow(kKeyframesAKill);
    }
    for (uint64_t enough = rng.Below(kNumUploaders * kKeyframesAKill); enough > 0; --enough) {
      ASSERT_TRUE(acknowledged_.try_acquire_for(kAnswerTimeout)) << "nothing is uploaded after kill " << kill;
    }
    SleepAtRandom(kLongestPause, rng);
    server().Kill();
    if (rng.Below(kKillsAStart) == 0) KillStartingServer(rng);
    if (kill % kKillsBetweenLooks == kKillsBetweenLooks - 1) ExpectSound(database(), Acknowledged());
    RestartServer();
  }
  address_.Set(server().address());
  for (const auto& one : operators_) one->ExpectAnswer();
  StopOperators();
  for (const auto& one : operators_) {
    EXPECT_GT(one->num_cut_short(), 0) << one->name();
    std::cout << one->name() << ": " << one->num_done() << " done, " << one->num_cut_short() << " cut short; ";
  }
  RestartServer();
  StopUploaders();
  int num_acknowledged = 0;
  for (const AcknowledgedKeyframes& session : Acknowledged()) num_acknowledged += static_cast<int>(session.count);
  std::cout << num_acknowledged << " keyframes acknowledged, " << num_retries_ << " attempts failed, "
            << NumKillsUnderLoad() << " kills, " << num_kills_at_start_ << " at the start, "
            << std::filesystem::file_size(database()) / 1'000'000 << " MB\n";
  EXPECT_EQ(server().Stop(), 0);
  ExpectSound(database(), Acknowledged());
  // Of which nobody was told, because the server was killed just then.
  for (const auto& entry : std::filesystem::directory_iterator(backups_)) {
    if (entry.path().extension() == ".db") ExpectSound(entry.path().string(), {});
  }
}

}  // namespace
}  // namespace mapp
