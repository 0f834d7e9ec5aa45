// Backups of a real server under upload, restored and served again; killed in the middle; and what is refused.

#include "storage/sqlite/sqlite_map_store.h"
#include "tests/e2e/service_fixture.h"
#include "tests/e2e/uploader.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <thread>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class BackupTest : public ServiceTest {
 protected:
  BackupTest() { fs::create_directory(backups_); }

  std::unique_ptr<ServerProcess> Serve(const std::string& database, int port = 0) {
    return std::make_unique<ServerProcess>(database, folder(), port,
                                           std::vector<std::string>{"--backup-dir", backups_});
  }
  /// A database of this many MB, which a copy takes some time for.
  static void MakeLargeDatabase(const std::string& file, int num_megabytes) {
    const auto store = OpenSqliteMapStore(file, {.sync_commits = false}).value();
    const Status written = store->Write({}, [&](MapWriter& writer) -> Status {
      MapRecord record;
      record.name = "large";
      MAPP_ASSIGN_OR_RETURN(const MapId map, writer.CreateMap(record));
      for (int i = 0; i < num_megabytes; ++i) {
        MAPP_RETURN_IF_ERROR(writer.AppendPlaceBlock(map, std::string(1'000'000, 'x')));
      }
      return absl::OkStatus();
    });
    ASSERT_TRUE(written.ok()) << written;
    ASSERT_TRUE(store->Close().ok());
  }
  static std::string BackUp(const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {"backup", "--json"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Finished finished = RunMapp(command);
    EXPECT_EQ(finished.exit_code, 0) << finished.err;
    return finished.out;
  }

  const std::string backups_ = folder().File("backups");
};

TEST_F(BackupTest, RestoresEveryKeyframeAcknowledgedBeforeExactlyOnce) {
  const std::string live = folder().File("map.db");
  const auto server = Serve(live);
  std::vector<std::unique_ptr<Uploader>> uploaders;
  for (int i = 0; i < 3; ++i) {
    uploaders.push_back(std::make_unique<Uploader>(UploaderOptions{.server = server->address(), .number = i}));
  }
  struct Expected {
    std::string backup;
    std::vector<AcknowledgedKeyframes> acknowledged;  ///< before the backup began
  };
  std::vector<Expected> rounds = {{backups_ + "/by_server.db", {}}, {backups_ + "/beside_server.db", {}}};
  for (size_t round = 0; round < rounds.size(); ++round) {
    const auto wanted = static_cast<uint32_t>(10 * (round + 1));
    for (const auto& uploader : uploaders) {
      while (uploader->num_acknowledged() < wanted) std::this_thread::yield();
      rounds[round].acknowledged.push_back(uploader->acknowledged());
    }
    if (round == 0) {
      BackUp({"--server", server->address(), "--to", rounds[round].backup});
    } else {
      BackUp({"--db", live, "--to", rounds[round].backup});
    }
  }
  for (const auto& uploader : uploaders) uploader->Stop();
  EXPECT_THAT(ExpectFailure({"restore", rounds[0].backup, "--db", live, "--yes"}), HasSubstr("in use by process"));
  EXPECT_EQ(server->Stop(), 0);

  for (const Expected& expected : rounds) {
    const std::string restored = expected.backup + ".restored";
    const Finished finished = RunMapp({"restore", expected.backup, "--db", restored});
    ASSERT_EQ(finished.exit_code, 0) << finished.err;
    const auto again = Serve(restored);
    EXPECT_EQ(RunMapp({"maps", "show", "room", "--server", again->address()}).exit_code, 0);
    const auto store = OpenSqliteMapStore(restored, {.read_only = true}).value();
    const auto reader = store->Read().value();
    SCOPED_TRACE(expected.backup);
    for (const AcknowledgedKeyframes& acknowledged : expected.acknowledged) ExpectKeyframes(*reader, acknowledged);
    EXPECT_EQ(again->Stop(), 0);
  }
}

TEST_F(BackupTest, ServerKilledInTheMiddleLeavesNothingThatLooksLikeABackup) {
  const std::string live = folder().File("map.db");
  MakeLargeDatabase(live, 40);
  const std::string target = backups_ + "/copy.db";
  auto server = Serve(live);
  int num_cut_short = 0;
  for (int attempt = 0; num_cut_short < 3; ++attempt) {
    ASSERT_LT(attempt, 100) << "no backup was ever caught in the middle";
    fs::remove(target);
    Process backup({MappBinary(), "backup", "--server", server->address(), "--to", target}, folder().path());
    while (!fs::exists(target + ".unfinished")) ASSERT_FALSE(backup.Wait(std::chrono::milliseconds(0)).has_value());
    const int port = server->port();
    server->Kill();
    const std::optional<int> exit_code = backup.Wait(std::chrono::seconds(60));
    if (!fs::exists(target)) {
      ++num_cut_short;
      EXPECT_EQ(exit_code, 1) << "who asked is told";
    } else {
      EXPECT_EQ(RunMapp({"restore", target, "--db", folder().File("none.db"), "--dry-run"}).exit_code, 0);
    }
    server = Serve(live, port);
  }
  // The next one takes over what the killed ones left.
  fs::remove(target);
  BackUp({"--server", server->address(), "--to", target});
  EXPECT_EQ(std::distance(fs::directory_iterator(backups_), {}), 1);
  EXPECT_EQ(RunMapp({"restore", target, "--db", folder().File("restored.db")}).exit_code, 0);
  EXPECT_EQ(ReadFile(folder().File("restored.db")).size(), fs::file_size(target));
}

TEST_F(BackupTest, InterruptedBackupLeavesNothing) {
  const std::string live = folder().File("map.db");
  MakeLargeDatabase(live, 40);
  const auto server = Serve(live);
  const std::string target = backups_ + "/copy.db";
  for (const std::vector<std::string>& source :
       std::vector<std::vector<std::string>>{{"--server", server->address()}, {"--db", live}}) {
    int num_interrupted = 0;
    for (int attempt = 0; num_interrupted < 1; ++attempt) {
      ASSERT_LT(attempt, 100) << "no backup was ever caught in the middle";
      fs::remove(target);
      std::vector<std::string> command = {MappBinary(), "backup", "--to", target};
      command.insert(command.end(), source.begin(), source.end());
      Process backup(command, folder().path());
      while (!fs::exists(target + ".unfinished")) ASSERT_FALSE(backup.Wait(std::chrono::milliseconds(0)).has_value());
      backup.Signal(SIGINT);
      if (backup.Wait(std::chrono::seconds(60)) != 1) continue;
      ++num_interrupted;
      EXPECT_THAT(backup.StandardError(), HasSubstr("interrupted: no backup was made"));
      while (!fs::is_empty(backups_)) std::this_thread::yield();  // the server tidies up behind the call
    }
  }
}

TEST_F(BackupTest, BadInputIsOneLineAndChangesNothing) {
  const std::string live = folder().File("map.db");
  MakeLargeDatabase(live, 1);
  const std::string good = backups_ + "/good.db";
  BackUp({"--db", live, "--to", good});
  const std::string text = folder().File("letter.txt");
  WriteFile(text, std::string(5000, 'x'));
  const std::string short_one = backups_ + "/short.db";
  WriteFile(short_one, ReadFile(good).substr(0, fs::file_size(good) / 2));
  const std::string before = ReadFile(live);
  struct Case {
    std::vector<std::string> arguments;
    std::string culprit;
  };
  const std::vector<Case> cases = {
      {{"backup", "--db", text, "--to", backups_}, "letter.txt: not a map database"},
      {{"backup", "--db", folder().File("none.db"), "--to", backups_}, "none.db: no such file"},
      {{"backup", "--db", live, "--to", good}, "good.db is there already"},
      {{"backup", "--db", live, "--to", "/sys/copy.db"}, "/sys/copy.db"},
      {{"backup", "--db", live, "--to", "/no/such/copy.db"}, "/no/such"},
      {{"backup", "--server", "127.0.0.1:1", "--to", backups_}, "127.0.0.1:1"},
      {{"restore", text, "--db", live, "--yes"}, "letter.txt: not a map database"},
      {{"restore", short_one, "--db", live, "--yes"}, "short.db"},
      {{"restore", folder().File("none.db"), "--db", live, "--yes"}, "none.db: no such file"},
      {{"restore", good, "--db", text, "--yes"}, "letter.txt: not a map database"},
      {{"restore", good, "--db", live}, "--yes"},
      {{"restore", good, "--db", good, "--yes"}, "the database itself"},
      {{"restore", good, "--db", "/sys/maps.db"}, "/sys/maps.db"},
  };
  for (const Case& bad : cases) EXPECT_THAT(ExpectFailure(bad.arguments), HasSubstr(bad.culprit));
  EXPECT_EQ(ReadFile(text), std::string(5000, 'x'));
  EXPECT_TRUE(ReadFile(live) == before);
  EXPECT_EQ(std::distance(fs::directory_iterator(backups_), {}), 2);

  const ServerProcess server(live, folder());
  EXPECT_THAT(ExpectFailure({"backup", "--server", server.address(), "--to", backups_}), HasSubstr("--backup-dir"));
  EXPECT_THAT(ExpectFailure({"restore", good, "--db", live, "--dry-run"}), HasSubstr("in use by process"));
}

TEST_F(BackupTest, HelpHasAnExample) {
  for (const char* command : {"backup", "restore"}) {
    const Finished help = RunMapp({command, "--help"});
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_THAT(help.out, AllOf(HasSubstr(fmt::format("Example: mapp {} ", command)), HasSubstr("--json")));
  }
}

}  // namespace
}  // namespace mapp
