// Restoring backups, and refusing to.
#include "storage/sqlite/restore.h"

#include "storage/sqlite/migrator.h"
#include "tests/unit/storage/database_fixture.h"
#include "tests/unit/storage/golden_database.h"

#include <fmt/format.h>

#include <filesystem>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

const auto kNow = std::chrono::system_clock::from_time_t(1'700'000'000);

class RestoreTest : public DatabaseTest {
 protected:
  RestoreTest() {
    const TempFolder source;
    MakeDatabase(source.File("maps.db"), 7);
    Value(BackUpDatabase({}, source.File("maps.db"), {.to = backup_}));
  }

  Status RestoreNow() {
    MAPP_ASSIGN_OR_RETURN(const RestorePlan plan, PlanRestore({}, backup_, file_, kNow));
    return Restore({}, plan, {});
  }
  /// The message of a refusal: one line, and nothing is changed.
  std::string RefusalOf(StatusCode code) {
    const auto before = Entries();
    const std::string bytes = ReadBytes(file_);
    const Status status = RestoreNow();
    EXPECT_THAT(status, HasCode(code));
    EXPECT_EQ(Entries(), before);
    EXPECT_TRUE(ReadBytes(file_) == bytes);
    const std::string message(status.message());
    EXPECT_THAT(message, Not(HasSubstr("\n")));
    return message;
  }

  const std::string backup_ = folder_.File("backup.db");
  const std::string kept_ = file_ + ".before-restore-20231114T221320Z";
};

TEST_F(RestoreTest, MakesADatabaseThatIsNotThere) {
  const RestorePlan plan = Value(PlanRestore({}, backup_, file_, kNow));
  EXPECT_EQ(plan.num_maps, 1);
  EXPECT_EQ(plan.num_keyframes, 7);
  EXPECT_EQ(plan.schema_version, static_cast<int>(sqlite::EmbeddedMigrations().size()));
  EXPECT_EQ(plan.num_bytes, static_cast<int64_t>(fs::file_size(backup_)));
  EXPECT_FALSE(plan.replaced_bytes.has_value());
  EXPECT_FALSE(fs::exists(file_)) << "a plan changes nothing";
  Check(Restore({}, plan, {}));
  EXPECT_FALSE(fs::exists(kept_));
  EXPECT_EQ(CountKeyframes(file_), 7);
}

TEST_F(RestoreTest, KeepsTheOldOneWithWhatWasInItsLog) {
  MakeKilledDatabase(file_, 4);
  const RestorePlan plan = Value(PlanRestore({}, backup_, file_, kNow));
  EXPECT_EQ(plan.kept_as, kept_);
  EXPECT_EQ(plan.replaced_bytes, static_cast<int64_t>(fs::file_size(file_) + fs::file_size(file_ + "-wal")));
  std::vector<RestoreStep> steps;
  Check(Restore({}, plan, [&](const RestoreProgress& progress) {
    if (steps.empty() || steps.back() != progress.step) steps.push_back(progress.step);
  }));
  EXPECT_THAT(steps, ElementsAre(RestoreStep::kCopying, RestoreStep::kChecking, RestoreStep::kClosing,
                                 RestoreStep::kKeeping, RestoreStep::kReplacing));
  EXPECT_FALSE(fs::exists(file_ + "-wal"));
  EXPECT_FALSE(fs::exists(file_ + "-shm"));
  EXPECT_EQ(CountKeyframes(file_), 7);
  EXPECT_EQ(CountKeyframes(kept_), 4);
}

TEST_F(RestoreTest, ReplacesADamagedDatabaseAndKeepsIt) {
  MakeDatabase(file_, 4);
  WriteBytes(file_ + "-wal", "a log that no database can take in");
  std::string bytes = ReadBytes(file_);
  bytes.replace(100, 16000, std::string(16000, '\x5a'));
  WriteBytes(file_, bytes);
  Check(RestoreNow());
  EXPECT_FALSE(fs::exists(file_ + "-wal"));
  EXPECT_EQ(CountKeyframes(file_), 7);
  EXPECT_TRUE(ReadBytes(kept_) == bytes);
}

TEST_F(RestoreTest, NothingOfADeletedDatabaseIsReplayed) {
  MakeKilledDatabase(file_, 4);
  fs::remove(file_);
  const std::string log = ReadBytes(file_ + "-wal");
  Check(RestoreNow());
  EXPECT_TRUE(ReadBytes(kept_ + "-wal") == log);
  EXPECT_EQ(CountKeyframes(file_), 7);
}

TEST_F(RestoreTest, TakesABackupWithALogOfItsOwn) {
  fs::remove(backup_);
  MakeKilledDatabase(backup_, 5);
  Check(RestoreNow());
  EXPECT_EQ(CountKeyframes(file_), 5);
}

TEST_F(RestoreTest, TakesAnOlderSchema) {
  fs::copy_file(GoldenDatabaseFile(1), backup_, fs::copy_options::overwrite_existing);
  const RestorePlan plan = Value(PlanRestore({}, backup_, file_, kNow));
  EXPECT_EQ(plan.schema_version, 1);
  EXPECT_EQ(plan.num_keyframes, 2);
  Check(Restore({}, plan, {}));
  EXPECT_EQ(Value(Value(OpenStore(file_)->Read())->ListMaps()).size(), 1U);
}

TEST_F(RestoreTest, KeepsPermissions) {
  MakeDatabase(file_, 1);
  fs::permissions(file_, fs::perms(0600));
  Check(RestoreNow());
  EXPECT_EQ(fs::status(file_).permissions(), fs::perms(0600));
}

TEST_F(RestoreTest, RestoresWhereALinkPoints) {
  MakeDatabase(folder_.File("real.db"), 1);
  fs::create_symlink(folder_.File("real.db"), file_);
  Check(RestoreNow());
  EXPECT_TRUE(fs::is_symlink(file_));
  EXPECT_EQ(CountKeyframes(folder_.File("real.db")), 7);
}

TEST_F(RestoreTest, RefusesALiveDatabase) {
  const auto store = OpenStore(file_);
  AddKeyframe(*store);
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("in use by process"));
  // A server that comes after the plan.
  Check(store->Close());
  const RestorePlan plan = Value(PlanRestore({}, backup_, file_, kNow));
  const auto again = OpenStore(file_);
  EXPECT_THAT(Restore({}, plan, {}), HasCode(StatusCode::kFailedPrecondition));
  EXPECT_EQ(Value(Value(again->Read())->FindMap("kitchen")).num_frames, 1);
}

TEST_F(RestoreTest, RefusesADatabaseThatAToolReads) {
  MakeDatabase(file_, 1);
  const auto tool = Value(OpenSqliteMapStore(file_, {.read_only = true}));
  const auto reader = Value(tool->Read());
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("open in another program"));
  EXPECT_EQ(Value(reader->FindMap("kitchen")).num_frames, 1);
}

TEST_F(RestoreTest, KeepsServersOutMeanwhile) {
  MakeDatabase(file_, 1);
  int num_refused = 0;
  Check(Restore({}, Value(PlanRestore({}, backup_, file_, kNow)), [&](const RestoreProgress&) {
    EXPECT_THAT(OpenSqliteMapStore(file_), HasCode(StatusCode::kFailedPrecondition));
    ++num_refused;
  }));
  EXPECT_GE(num_refused, 5);
}

TEST_F(RestoreTest, RefusesBackupsThatAreNone) {
  MakeDatabase(file_, 1);
  fs::resize_file(backup_, fs::file_size(backup_) / 2 / 16384 * 16384);
  EXPECT_THAT(RefusalOf(StatusCode::kDataLoss), HasSubstr("backup.db: "));
  fs::resize_file(backup_, 10'000);
  RefusalOf(StatusCode::kDataLoss);
  WriteBytes(backup_, "");
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("empty"));
  WriteBytes(backup_, std::string(5000, 'x'));
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("not a map database"));
  fs::remove(backup_);
  EXPECT_THAT(RefusalOf(StatusCode::kNotFound), HasSubstr("backup.db: no such file"));
  RunSqlOn(backup_, "CREATE TABLE recipes (name TEXT);");
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("another program"));
}

TEST_F(RestoreTest, RefusesADamagedBackup) {
  MakeDatabase(file_, 1);
  Damage(backup_);
  RefusalOf(StatusCode::kDataLoss);
}

TEST_F(RestoreTest, RefusesANewerBackupByNumber) {
  const size_t newest = sqlite::EmbeddedMigrations().size();
  RunSqlOn(backup_, fmt::format("PRAGMA user_version = {};", newest + 1));
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition),
              HasSubstr(fmt::format("database schema {} is newer than this program's {}", newest + 1, newest)));
}

TEST_F(RestoreTest, RefusesToReplaceWhatIsNoMapDatabase) {
  RunSqlOn(file_, "CREATE TABLE recipes (name TEXT);");
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("another program's"));
  WriteBytes(file_, "a letter to my aunt");
  EXPECT_THAT(RefusalOf(StatusCode::kFailedPrecondition), HasSubstr("not a map database"));
  fs::remove(file_);
  fs::create_directory(file_);
  EXPECT_THAT(PlanRestore({}, backup_, file_, kNow), HasCode(StatusCode::kFailedPrecondition));
  EXPECT_THAT(PlanRestore({}, backup_, folder_.File("missing/maps.db"), kNow), HasCode(StatusCode::kNotFound));
}

TEST_F(RestoreTest, RefusesADatabaseAsItsOwnBackup) {
  EXPECT_THAT(PlanRestore({}, backup_, backup_, kNow), HasCode(StatusCode::kInvalidArgument));
}

TEST_F(RestoreTest, ThatIsCancelledChangesNothing) {
  MakeDatabase(file_, 1);
  const RestorePlan plan = Value(PlanRestore({}, backup_, file_, kNow));
  const auto before = Entries();
  CallContext context;
  bool cancelled = false;
  context.is_cancelled = [&] { return cancelled; };
  EXPECT_THAT(Restore(context, plan, [&](const RestoreProgress&) { cancelled = true; }),
              HasCode(StatusCode::kCancelled));
  EXPECT_EQ(Entries(), before);
  EXPECT_EQ(CountKeyframes(file_), 1);
}

TEST_F(RestoreTest, ThatCannotKeepTheOldOneChangesNothing) {
  MakeDatabase(file_, 1);
  WriteBytes(kept_, "there already");
  EXPECT_THAT(RefusalOf(StatusCode::kAlreadyExists), HasSubstr(kept_));
  EXPECT_EQ(CountKeyframes(file_), 1);
}

}  // namespace
}  // namespace mapp
