#include "storage/sqlite/migrator.h"

#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/golden_database.h"
#include "tests/unit/storage/store_fixture.h"

namespace mapp::sqlite {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr Migration kFirst = {
    .version = 1,
    .name = "0001_first.sql",
    .sha256 = "aa",
    .sql =
        "CREATE TABLE schema_migrations (version INTEGER PRIMARY KEY, name TEXT, sha256 TEXT, applied_ns INTEGER);"
        "CREATE TABLE things (name TEXT); INSERT INTO things VALUES ('old');"};
constexpr Migration kSecond = {.version = 2,
                               .name = "0002_second.sql",
                               .sha256 = "bb",
                               .sql = "ALTER TABLE things ADD COLUMN color TEXT; UPDATE things SET color = 'red';"};
constexpr Migration kBroken = {.version = 3,
                               .name = "0003_broken.sql",
                               .sha256 = "cc",
                               .sql = "UPDATE things SET color = 'blue'; INSERT INTO missing VALUES (1);"};

class MigratorTest : public testing::Test {
 protected:
  std::unique_ptr<Connection> Open(const std::string& file) {
    return Value(Connection::Open(file, Connection::Mode::kCreate, std::chrono::seconds(1)));
  }
  Status MigrateTo(const std::vector<Migration>& migrations, const MigrateOptions& options = {}) {
    return Migrate(*Open(file_), file_, migrations, options);
  }
  int64_t Query(const std::string& sql) { return Value(Open(file_)->QueryInt64(sql)); }

  TempFolder folder_;
  const std::string file_ = folder_.File("maps.db");
  const std::string backup_ = file_ + ".schema-1.backup";
};

TEST_F(MigratorTest, AppliesWhatIsMissingInOrder) {
  Check(MigrateTo({kFirst}, {.now_ns = 10}));
  EXPECT_EQ(Query("PRAGMA user_version"), 1);
  Check(MigrateTo({kFirst, kSecond}, {.now_ns = 20}));
  EXPECT_EQ(Query("PRAGMA user_version"), 2);
  EXPECT_EQ(Query("SELECT count(*) FROM things WHERE color = 'red'"), 1);
  EXPECT_EQ(Query("SELECT applied_ns FROM schema_migrations WHERE version = 2 AND sha256 = 'bb'"), 20);
  Check(MigrateTo({kFirst, kSecond}));
  EXPECT_EQ(Query("SELECT count(*) FROM schema_migrations"), 2);
}

TEST_F(MigratorTest, BacksUpAnOlderDatabaseButNotANewOne) {
  Check(MigrateTo({kFirst}));
  EXPECT_FALSE(std::filesystem::exists(backup_));
  Check(MigrateTo({kFirst, kSecond}));
  const auto backup = Open(backup_);
  EXPECT_EQ(Value(backup->QueryInt64("PRAGMA user_version")), 1);
  EXPECT_EQ(Value(backup->QueryInt64("SELECT count(*) FROM things")), 1);
}

TEST_F(MigratorTest, BacksUpOnlyWhenAsked) {
  Check(MigrateTo({kFirst}));
  Check(MigrateTo({kFirst, kSecond}, {.backup = false}));
  EXPECT_FALSE(std::filesystem::exists(backup_));
}

TEST_F(MigratorTest, BrokenMigrationLeavesTheVersionBefore) {
  Check(MigrateTo({kFirst}));
  const Status status = MigrateTo({kFirst, kSecond, kBroken});
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()), HasSubstr("0003_broken.sql"));
  EXPECT_EQ(Query("PRAGMA user_version"), 2);
  EXPECT_EQ(Query("SELECT count(*) FROM things WHERE color = 'red'"), 1);
}

TEST_F(MigratorTest, RefusesANewerDatabaseAndAnother) {
  Check(MigrateTo({kFirst, kSecond}));
  EXPECT_THAT(MigrateTo({kFirst}), HasCode(StatusCode::kFailedPrecondition));
  Migration changed = kFirst;
  changed.sha256 = "dd";
  EXPECT_THAT(MigrateTo({changed, kSecond}), HasCode(StatusCode::kFailedPrecondition));
}

TEST_F(MigratorTest, EmbedsTheMigrationsOfTheRepository) {
  const auto migrations = EmbeddedMigrations();
  ASSERT_FALSE(migrations.empty());
  for (size_t i = 0; i < migrations.size(); ++i) {
    EXPECT_EQ(migrations[i].version, static_cast<int>(i + 1));
    EXPECT_EQ(std::string(migrations[i].sha256).size(), 64U);
  }
}

/// Databases as released programs left them, one for each schema.
class GoldenDatabaseTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Schemas, GoldenDatabaseTest, testing::Values(1, 2, 3, 4, 5, 6));

TEST_P(GoldenDatabaseTest, MigratesAndKeepsItsContent) {
  const TempFolder folder;
  const std::string file = folder.File("maps.db");
  std::filesystem::copy_file(GoldenDatabaseFile(GetParam()), file);
  const auto store = Value(OpenSqliteMapStore(file));
  ExpectGoldenContent(*Value(store->Read()));
  Check(store->Write({}, [](MapWriter& writer) { return writer.DeleteMap(Value(writer.FindMap("golden")).id); }));
}

}  // namespace
}  // namespace mapp::sqlite
