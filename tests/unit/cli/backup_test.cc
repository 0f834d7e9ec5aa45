#include "cli/backup.h"

#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <sstream>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// Runs `mapp backup` and `mapp restore` on files.
class BackupCommandTest : public ::testing::Test {
 protected:
  BackupCommandTest() { MakeDatabase(database_, {"hall", "yard"}); }

  static void MakeDatabase(const std::string& file, const std::vector<std::string>& map_names) {
    const auto store = OpenSqliteMapStore(file);
    ASSERT_TRUE(store.ok()) << store.status();
    for (const std::string& name : map_names) {
      const Status added = (*store)->Write({}, [&](MapWriter& writer) {
        MapRecord map;
        map.name = name;
        return writer.CreateMap(map).status();
      });
      ASSERT_TRUE(added.ok()) << added;
    }
    ASSERT_TRUE((*store)->Close().ok());
  }
  static size_t CountMaps(const std::string& file) {
    return OpenSqliteMapStore(file, {.read_only = true}).value()->Read().value()->ListMaps().value().size();
  }
  std::string BackUp() {
    BackupCommandOptions options;
    options.database = database_;
    options.to = folder_.File("copy.db");
    std::ostringstream out;
    const Status status = RunBackup(options, {}, out);
    EXPECT_TRUE(status.ok()) << status;
    return options.to;
  }
  RestoreCommandOptions RestoreOptions(const std::string& backup) const {
    RestoreCommandOptions options;
    options.backup = backup;
    options.database = target_;
    options.now = std::chrono::system_clock::from_time_t(1'700'000'000);
    return options;
  }
  /// With `answer` typed at the question; what was printed is in out_.
  Status Restore(const RestoreCommandOptions& options, const std::string& answer = "") {
    std::istringstream in(answer);
    out_.str("");
    return RunRestore(options, {}, in, out_);
  }

  const test::TempFolder folder_;
  const std::string database_ = folder_.File("maps.db");
  const std::string target_ = folder_.File("target.db");
  const std::string kept_ = target_ + ".before-restore-20231114T221320Z";
  std::ostringstream out_;
};

TEST_F(BackupCommandTest, BackupSaysWhereItIsAndWhatWent) {
  fs::create_directory(folder_.path() / "backups");
  BackupCommandOptions options;
  options.database = database_;
  options.to = folder_.File("backups");
  std::ofstream(folder_.path() / "backups" / "maps-20200101T000000Z.db") << "old";
  options.num_kept = 1;
  options.dry_run = true;
  ASSERT_TRUE(RunBackup(options, {}, out_).ok());
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("would write " + options.to + "/maps-2"),
                                HasSubstr("would delete " + options.to + "/maps-20200101T000000Z.db")));
  EXPECT_TRUE(fs::exists(folder_.path() / "backups" / "maps-20200101T000000Z.db"));
  EXPECT_EQ(std::distance(fs::directory_iterator(options.to), {}), 1);
  out_.str("");
  options.dry_run = false;
  options.json = true;
  const Status status = RunBackup(options, {}, out_);
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("\"file\": \"" + options.to + "/maps-2"), HasSubstr("\"schema_version\": "),
                                HasSubstr("\"num_bytes\": "), HasSubstr("maps-20200101T000000Z.db")));
  EXPECT_EQ(std::distance(fs::directory_iterator(options.to), {}), 1);
}

TEST_F(BackupCommandTest, ErrorsNameTheDatabase) {
  BackupCommandOptions options;
  options.database = folder_.File("missing.db");
  options.to = folder_.File("copy.db");
  const Status status = RunBackup(options, {}, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(status.ToString(), HasSubstr("missing.db: no such file"));
  EXPECT_FALSE(fs::exists(options.to));
  EXPECT_THAT(out_.str(), IsEmpty());
}

TEST_F(BackupCommandTest, StoppedBackupLeavesNothingAndSaysSo) {
  BackupCommandOptions options;
  options.database = database_;
  options.to = folder_.File("copy.db");
  std::stop_source stopped;
  stopped.request_stop();
  const Status status = RunBackup(options, stopped.get_token(), out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_THAT(status.ToString(), HasSubstr("interrupted"));
  EXPECT_FALSE(fs::exists(options.to));
  EXPECT_FALSE(fs::exists(options.to + ".unfinished"));
}

TEST_F(BackupCommandTest, RestoreIntoANewFileAsksNothing) {
  const Status status = Restore(RestoreOptions(BackUp()));
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("restored " + target_), HasSubstr("2 maps"), Not(HasSubstr("[y/N]")),
                                Not(HasSubstr("before-restore"))));
  EXPECT_EQ(CountMaps(target_), 2U);
}

TEST_F(BackupCommandTest, RestoreAsksBeforeItReplaces) {
  MakeDatabase(target_, {"attic"});
  RestoreCommandOptions options = RestoreOptions(BackUp());
  EXPECT_THAT(Restore(options).ToString(), HasSubstr("--yes"));
  options.interactive = true;
  EXPECT_EQ(Restore(options, "n\n").code(), absl::StatusCode::kCancelled);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr(target_), HasSubstr("2 maps"), HasSubstr(kept_), HasSubstr("[y/N]")));
  EXPECT_EQ(CountMaps(target_), 1U);
  EXPECT_FALSE(fs::exists(kept_));
  const Status status = Restore(options, "y\n");
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_EQ(CountMaps(target_), 2U);
  EXPECT_EQ(CountMaps(kept_), 1U);
}

TEST_F(BackupCommandTest, DryRunSaysWhatWouldBeDone) {
  RestoreCommandOptions options = RestoreOptions(BackUp());
  options.dry_run = true;
  ASSERT_TRUE(Restore(options).ok());
  EXPECT_THAT(out_.str(), HasSubstr("would restore " + target_));
  EXPECT_FALSE(fs::exists(target_));
  EXPECT_FALSE(fs::exists(target_ + ".lock"));

  MakeDatabase(target_, {"attic"});
  options.json = true;
  ASSERT_TRUE(Restore(options).ok());
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("\"restored\": false"), HasSubstr("\"num_maps\": 2"),
                                HasSubstr("\"kept_as\": \"" + kept_ + "\"")));
  EXPECT_EQ(CountMaps(target_), 1U);
  EXPECT_FALSE(fs::exists(kept_));
}

TEST_F(BackupCommandTest, RestoreOfAFileCutShortChangesNothing) {
  MakeDatabase(target_, {"attic"});
  RestoreCommandOptions options = RestoreOptions(BackUp());
  fs::resize_file(options.backup, fs::file_size(options.backup) / 2);
  options.yes = true;
  const Status status = Restore(options);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(status.ToString(), HasSubstr("copy.db: "));
  EXPECT_EQ(CountMaps(target_), 1U);
}

}  // namespace
}  // namespace mapp
