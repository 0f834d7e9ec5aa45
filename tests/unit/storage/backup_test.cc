// Backups of a database that others write, and what can go wrong with them.
#include "storage/sqlite/backup.h"

#include "mapp/base/bytes.h"
#include "storage/sqlite/migrator.h"
#include "tests/unit/storage/database_fixture.h"
#include "tests/unit/storage/golden_database.h"

#include <fmt/format.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsSupersetOf;
using testing::Not;

class BackupTest : public DatabaseTest {
 protected:
  BackupTest() { fs::create_directory(folder_.path() / "backups"); }

  StatusOr<Backup> BackUpTo(const std::string& to, BackupOptions options = {}, const CallContext& context = {}) {
    options.to = to;
    return BackUpDatabase(context, file_, options);
  }
  /// The message of a refusal: one line, and nothing is made.
  std::string RefusalOf(const std::string& to, StatusCode code, BackupOptions options = {},
                        const CallContext& context = {}) {
    const auto before = Entries("backups");
    const auto backup = BackUpTo(to, std::move(options), context);
    EXPECT_THAT(backup, HasCode(code));
    EXPECT_EQ(Entries("backups"), before);
    const std::string message(backup.status().message());
    EXPECT_THAT(message, Not(HasSubstr("\n")));
    return message;
  }
  static std::chrono::system_clock::time_point Time(int seconds) {
    return std::chrono::system_clock::from_time_t(1'700'000'000 + seconds);
  }

  const std::string backups_ = folder_.File("backups");
  const std::string target_ = backups_ + "/copy.db";
};

TEST_F(BackupTest, CopiesWhatIsStillInTheLogOfAnOpenDatabase) {
  const auto store = OpenStore(file_);
  for (int i = 0; i < 5; ++i) AddKeyframe(*store);
  const Backup backup = Value(BackUpTo(target_));
  EXPECT_EQ(backup.file, target_);
  EXPECT_EQ(backup.num_bytes, static_cast<int64_t>(fs::file_size(target_)));
  EXPECT_EQ(backup.schema_version, static_cast<int>(sqlite::EmbeddedMigrations().size()));
  EXPECT_THAT(Entries("backups"), ElementsAre("copy.db"));
  EXPECT_EQ(CountKeyframes(target_), 5);
}

TEST_F(BackupTest, EndsAlthoughThereIsACommitBetweenAnyTwoSteps) {
  const auto store = OpenStore(file_);
  for (int i = 0; i < 5; ++i) AddKeyframe(*store);
  int num_steps = 0;
  BackupOptions options{.pages_per_step = 1};
  options.on_progress = [&](const BackupProgress& progress) {
    EXPECT_LE(progress.bytes_done, progress.bytes_total);
    AddKeyframe(*store);
    ++num_steps;
  };
  CallContext context;
  context.is_cancelled = [&] { return num_steps > 1000; };  // a copy that begins anew after every commit
  Value(BackUpTo(target_, options, context));
  EXPECT_GT(num_steps, 10);
  EXPECT_EQ(CountKeyframes(target_), 5) << "the state when it began";
  EXPECT_EQ(Value(Value(store->Read())->FindMap("kitchen")).num_frames, 5 + num_steps);
}

TEST_F(BackupTest, IsOneCommitWhileOthersWrite) {
  const auto store = OpenStore(file_);
  AddKeyframe(*store);
  std::atomic<bool> done{false};
  std::atomic<int> num_acknowledged{1};
  std::jthread writer([&] {
    while (!done) {
      AddKeyframe(*store);
      ++num_acknowledged;
    }
  });
  for (int i = 0; i < 5; ++i) {
    const int num_before = num_acknowledged;
    const std::string target = fmt::format("{}/{}.db", backups_, i);
    Value(BackUpTo(target, {.pages_per_step = 3}));
    EXPECT_GE(CountKeyframes(target), num_before);
  }
  done = true;
}

TEST_F(BackupTest, IsOneFileThatIsReadWhereNothingCanBeWritten) {
  MakeDatabase(file_, 1);
  Value(BackUpTo(target_));
  constexpr size_t kJournalModeOffset = 18;
  EXPECT_EQ(ReadBytes(target_)[kJournalModeOffset], 1) << "no write-ahead log";
  const auto reader = Value(OpenSqliteMapStore(target_, {.read_only = true}));
  Value(reader->Read());
  EXPECT_THAT(Entries("backups"), ElementsAre("copy.db"));
}

TEST_F(BackupTest, IsReadByWhoMayReadTheDatabase) {
  MakeDatabase(file_, 1);
  fs::permissions(file_, fs::perms(0640));
  BackupOptions options;
  options.on_progress = [&](const BackupProgress&) {
    EXPECT_EQ(fs::status(target_ + ".unfinished").permissions(), fs::perms(0640));
  };
  Value(BackUpTo(target_, options));
  EXPECT_EQ(fs::status(target_).permissions(), fs::perms(0640));
}

TEST_F(BackupTest, CopiesAnOlderSchemaAsItIs) {
  fs::copy_file(GoldenDatabaseFile(2), file_);
  EXPECT_EQ(Value(BackUpTo(target_)).schema_version, 2);
}

TEST_F(BackupTest, IsNamedByItsTimeInAFolderWhereTheOldestGo) {
  MakeDatabase(file_, 1);
  const std::vector<std::string> others = {"maps-20200101T000000Z.db.unfinished",
                                           "maps-20200101T000000Z.db-wal",
                                           "other-20200101T000000Z.db",
                                           "maps-2020.db",
                                           "maps-20200101T00000xZ.db",
                                           "maps.db",
                                           "xmaps-20200101T000000Z.db"};
  for (const std::string& other : others) WriteBytes(backups_ + "/" + other, "not a backup of maps.db");
  fs::create_directory(backups_ + "/maps-20200102T000000Z.db");
  fs::create_symlink(file_, backups_ + "/maps-20200103T000000Z.db");
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(Value(BackUpTo(backups_, {.now = Time(i)})).deleted.empty());
  const Backup last = Value(BackUpTo(backups_ + "/", {.num_kept = 2, .now = Time(3)}));
  EXPECT_EQ(last.file, backups_ + "/maps-20231114T221323Z.db");
  EXPECT_THAT(last.deleted,
              ElementsAre(backups_ + "/maps-20231114T221320Z.db", backups_ + "/maps-20231114T221321Z.db"));
  const auto entries = Entries("backups");
  EXPECT_THAT(entries, IsSupersetOf(others));
  EXPECT_EQ(entries.size(), others.size() + 2 + 2);
  EXPECT_EQ(CountKeyframes(last.file), 1);
}

TEST_F(BackupTest, KeepsTheOneJustMadeWhenTheClockWentBack) {
  MakeDatabase(file_, 1);
  Value(BackUpTo(backups_, {.now = Time(100)}));
  const Backup last = Value(BackUpTo(backups_, {.num_kept = 1, .now = Time(0)}));
  EXPECT_EQ(last.deleted.size(), 1U);
  EXPECT_TRUE(fs::exists(last.file));
}

TEST_F(BackupTest, ThatFailsDeletesNoOldOne) {
  MakeDatabase(file_, 3);
  Value(BackUpTo(backups_, {.now = Time(0)}));
  RefusalOf(backups_, StatusCode::kResourceExhausted, {.num_kept = 1, .max_pages = 4, .now = Time(1)});
}

TEST_F(BackupTest, ReplacesNothing) {
  MakeDatabase(file_, 1);
  WriteBytes(target_, "precious");
  EXPECT_THAT(RefusalOf(target_, StatusCode::kAlreadyExists), HasSubstr(target_));
  EXPECT_EQ(ReadBytes(target_), "precious");
  RefusalOf(file_, StatusCode::kAlreadyExists);
}

TEST_F(BackupTest, ThatIsCancelledLeavesNothing) {
  MakeDatabase(file_, 10);
  for (const bool while_checking : {false, true}) {
    bool cancelled = false;
    BackupOptions options{.pages_per_step = 1};
    options.on_progress = [&](const BackupProgress& progress) { cancelled = !while_checking || progress.checking; };
    CallContext context;
    context.is_cancelled = [&] { return cancelled; };
    RefusalOf(target_, StatusCode::kCancelled, options, context);
  }
}

TEST_F(BackupTest, WithoutRoomFailsAtOnceOrAtTheEndAndLeavesNothing) {
  MakeDatabase(file_, 10);
  EXPECT_THAT(RefusalOf(target_, StatusCode::kResourceExhausted, {.pages_per_step = 2, .max_pages = 8}),
              HasSubstr("disk full"));
  // A database that says to be of 8 TB, most of it a hole.
  constexpr uint64_t kBytes = uint64_t{8} << 40;
  fs::resize_file(file_, kBytes);
  constexpr size_t kPageBytes = 16384;
  constexpr size_t kPageCountOffset = 28;
  constexpr uint32_t kNumPages = kBytes / kPageBytes;
  std::fstream file(file_, std::ios::binary | std::ios::in | std::ios::out);
  std::string content(kPageBytes - 8, '\0');  // of the first page, in front of its checksum
  file.read(content.data(), static_cast<std::streamsize>(content.size()));
  for (size_t i = 0; i < 4; ++i) content[kPageCountOffset + i] = static_cast<char>(kNumPages >> (24 - 8 * i));
  ByteWriter forged;
  forged.PutBytes(content);
  forged.Put<uint32_t>(Crc32c(content));
  file.seekp(0);
  file << forged.bytes();
  file.close();
  EXPECT_THAT(RefusalOf(target_, StatusCode::kResourceExhausted), HasSubstr("needs 8796094 MB"));
}

TEST_F(BackupTest, OfADamagedDatabaseIsNone) {
  MakeDatabase(file_, 3);
  Damage(file_);
  RefusalOf(target_, StatusCode::kDataLoss);
}

TEST_F(BackupTest, OfAFileCutShortIsNone) {
  MakeDatabase(file_, 3);
  fs::resize_file(file_, fs::file_size(file_) / 2 / 16384 * 16384);
  EXPECT_THAT(RefusalOf(target_, StatusCode::kDataLoss), HasSubstr("corrupt"));
}

TEST_F(BackupTest, RefusesWhatIsNoMapDatabase) {
  EXPECT_THAT(RefusalOf(target_, StatusCode::kNotFound), HasSubstr("no such file"));
  WriteBytes(file_, std::string(5000, 'x'));
  EXPECT_THAT(RefusalOf(target_, StatusCode::kFailedPrecondition), HasSubstr("not a map database"));
  WriteBytes(file_, "");
  EXPECT_THAT(RefusalOf(target_, StatusCode::kFailedPrecondition), HasSubstr("empty"));
  fs::remove(file_);
  RunSqlOn(file_, "CREATE TABLE recipes (name TEXT);");
  EXPECT_THAT(RefusalOf(target_, StatusCode::kFailedPrecondition), HasSubstr("another program"));
}

TEST_F(BackupTest, RefusesNamesThatMeanSomethingElse) {
  MakeDatabase(file_, 1);
  for (const char* suffix : {"-wal", "-journal", "-shm", ".lock", ".unfinished"}) {
    EXPECT_THAT(RefusalOf(backups_ + "/maps.db" + suffix, StatusCode::kInvalidArgument), HasSubstr(suffix));
  }
  RefusalOf("", StatusCode::kInvalidArgument);
  EXPECT_THAT(RefusalOf(target_, StatusCode::kInvalidArgument, {.num_kept = 3}), HasSubstr("no folder"));
  RefusalOf(backups_, StatusCode::kInvalidArgument, {.num_kept = -1});
}

TEST_F(BackupTest, RefusesAMissingFolderAndOneItMayNotWrite) {
  MakeDatabase(file_, 1);
  EXPECT_THAT(RefusalOf(folder_.File("missing/copy.db"), StatusCode::kNotFound), HasSubstr("missing does not exist"));
  EXPECT_THAT(RefusalOf(folder_.File("missing/"), StatusCode::kNotFound), HasSubstr("missing"));
  if (geteuid() != 0) GTEST_SKIP() << "the rest needs root, to become a user without rights";
  fs::permissions(folder_.path(), fs::perms(0777));
  fs::permissions(backups_, fs::perms(0555));
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(seteuid(kNobody), 0);
  const std::string message = RefusalOf(target_, StatusCode::kFailedPrecondition);
  ASSERT_EQ(seteuid(0), 0);
  EXPECT_THAT(message, AllOf(HasSubstr(target_), HasSubstr("Permission denied")));
}

TEST_F(BackupTest, OneAtATimeWritesAFile) {
  MakeDatabase(file_, 3);
  int num_refused = 0;
  BackupOptions options;
  options.on_progress = [&](const BackupProgress&) {
    const auto second = BackUpTo(target_);
    EXPECT_THAT(second, HasCode(StatusCode::kFailedPrecondition));
    EXPECT_THAT(std::string(second.status().message()), HasSubstr("another process is writing it"));
    ++num_refused;
  };
  Value(BackUpTo(target_, options));
  EXPECT_GT(num_refused, 0);
  EXPECT_EQ(CountKeyframes(target_), 3);
}

TEST_F(BackupTest, FollowsNoLinkThatSomebodyHasPutInItsWay) {
  MakeDatabase(file_, 1);
  const std::string precious = folder_.File("precious");
  WriteBytes(precious, "precious");
  fs::create_symlink(precious, target_ + ".unfinished");
  RefusalOf(target_, StatusCode::kFailedPrecondition);
  EXPECT_EQ(ReadBytes(precious), "precious");
}

}  // namespace
}  // namespace mapp
