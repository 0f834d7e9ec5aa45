#include "storage/sqlite/checksum_vfs.h"

#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/golden_database.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <csignal>
#include <fstream>
#include <sys/wait.h>
#include <unistd.h>

namespace mapp::sqlite {
namespace {

using absl::StatusCode;
using testing::HasSubstr;
using testing::Not;

constexpr size_t kPageBytes = 4096;
constexpr size_t kReservedBytesOffset = 20;

std::unique_ptr<Connection> Open(const std::string& file, Connection::Mode mode = Connection::Mode::kCreate) {
  return Value(Connection::Open(file, mode, std::chrono::seconds(1)));
}

std::string ReadFile(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void FlipBit(const std::string& file, size_t byte, int bit) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekg(static_cast<std::streamoff>(byte));
  const auto flipped = static_cast<char>(stream.get() ^ (1 << bit));
  stream.seekp(static_cast<std::streamoff>(byte));
  stream.put(flipped);
}

/// A database of some rows, with values of less and of more than a page, an index, and unless told otherwise checksums.
class ChecksumVfsTest : public testing::Test {
 protected:
  std::unique_ptr<Connection> Create(const std::string& journal, bool with_checksums = true) {
    auto db = Open(file_);
    Check(db->Execute(fmt::format("PRAGMA page_size = {};", kPageBytes)));
    if (with_checksums) ReserveTrailer(*db);
    Check(
        db->Execute(fmt::format("PRAGMA auto_vacuum = INCREMENTAL; PRAGMA journal_mode = {}; PRAGMA synchronous = OFF;"
                                "PRAGMA secure_delete = OFF;"
                                "CREATE TABLE t (id INTEGER PRIMARY KEY, name TEXT, value BLOB);"
                                "CREATE INDEX t_name ON t (name);",
                                journal)));
    return db;
  }
  static void Insert(Connection& db, int first, int count) {
    const auto transaction = Value(Transaction::Begin(db, Transaction::Kind::kWrite));
    for (int i = first; i < first + count; ++i) {
      const std::string name = "row " + std::to_string(i);
      const std::string value = TestBytes(i, 200 + 997 * (i % 20));
      Check(db.Prepare("INSERT INTO t VALUES (?, ?, ?)").Bind(i, name, Blob{value}).Run());
    }
    Check(transaction->Commit());
  }
  /// All rows in both orders, through a connection that has nothing in its cache.
  StatusOr<std::string> Content() const {
    std::string content;
    const auto db = Open(file_, Connection::Mode::kReadWrite);
    for (const char* order : {"id", "name"}) {
      Statement rows = db->Prepare(fmt::format("SELECT id, name, value FROM t ORDER BY {}", order));
      for (;;) {
        MAPP_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
        if (!has_row) break;
        content += fmt::format("{} {} {:08x}\n", rows.Int64(0), rows.Bytes(1), Crc32c(rows.Bytes(2)));
      }
    }
    return content;
  }
  /// Every page of the file that was ever written carries the checksum that docs/formats/database.md says.
  void ExpectSealed(size_t page_bytes = kPageBytes) const {
    const std::string bytes = ReadFile(file_);
    ASSERT_EQ(bytes.size() % page_bytes, 0U);
    ASSERT_EQ(bytes[kReservedBytesOffset], kPageTrailerBytes);
    for (uint32_t page = 1; page <= bytes.size() / page_bytes; ++page) {
      const std::string_view content = std::string_view(bytes).substr((page - 1) * page_bytes, page_bytes);
      if (content.find_first_not_of('\0') == std::string_view::npos) continue;
      ByteReader trailer(content.substr(page_bytes - 8));
      EXPECT_EQ(trailer.Get<uint32_t>(), Crc32c(content.substr(0, page_bytes - 8))) << "page " << page;
      EXPECT_EQ(trailer.Get<uint32_t>(), 0xfec5fec5U ^ page);
    }
  }
  static void ExpectSound(Connection& db) {
    Statement check = db.Prepare("PRAGMA integrity_check");
    Value(check.Step());
    EXPECT_EQ(check.Bytes(0), "ok");
  }

  TempFolder folder_;
  const std::string file_ = folder_.File("t.db");
};

TEST_F(ChecksumVfsTest, SealsPagesInEveryJournalMode) {
  for (const char* journal : {"WAL", "DELETE", "MEMORY"}) {
    SCOPED_TRACE(journal);
    auto db = Create(journal);
    Check(db->Execute("PRAGMA cache_size = 10;"));  // pages reach the file before their transaction ends
    Insert(*db, 0, 300);
    Check(db->Execute("DELETE FROM t WHERE id % 3 = 0;"));
    Insert(*db, 300, 100);
    EXPECT_TRUE(HasChecksums(*db));
    ExpectSound(*db);
    db.reset();
    ExpectSealed();
    EXPECT_THAT(Value(Content()), HasSubstr("row 399"));
    std::filesystem::remove(file_);
  }
}

TEST_F(ChecksumVfsTest, SqliteReadsTheFileByItself) {
  auto db = Create("WAL");
  Insert(*db, 0, 50);
  db.reset();
  sqlite3* plain = nullptr;
  ASSERT_EQ(sqlite3_open_v2(file_.c_str(), &plain, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  std::string answer;
  sqlite3_exec(
      plain, "PRAGMA integrity_check; SELECT count(*) FROM t;",
      [](void* text, int, char** values, char**) {
        *static_cast<std::string*>(text) += values[0];
        return 0;
      },
      &answer, nullptr);
  sqlite3_close(plain);
  EXPECT_EQ(answer, "ok50");
}

TEST_F(ChecksumVfsTest, CheckpointsWhileOthersReadAreSealed) {
  const auto writer = Create("WAL");
  Insert(*writer, 0, 50);
  const auto reader = Open(file_, Connection::Mode::kReadOnly);
  const auto snapshot = Value(Transaction::Begin(*reader, Transaction::Kind::kSnapshot));
  Insert(*writer, 50, 50);
  // As far as the reader's snapshot lets it; the rest stays in the log.
  Value(writer->QueryInt64("PRAGMA wal_checkpoint(PASSIVE)"));
  EXPECT_EQ(Value(reader->QueryInt64("SELECT count(*) FROM t WHERE length(value) > 0")), 50);
  ExpectSealed();
  EXPECT_THAT(Value(Content()), HasSubstr("row 99"));
}

TEST_F(ChecksumVfsTest, EveryFlippedBitIsFoundAndItsPageNamed) {
  auto db = Create("WAL");
  Insert(*db, 0, 60);
  db.reset();
  const std::string content = Value(Content());
  Rng rng(7);
  std::vector<size_t> bytes = {100, kPageBytes - 8, kPageBytes - 1};
  constexpr size_t kAfterMagic = 16;  // a file that does not begin as a database is none to SQLite
  for (size_t byte = kAfterMagic; byte < 100; ++byte) bytes.push_back(byte);
  const size_t num_pages = std::filesystem::file_size(file_) / kPageBytes;
  for (size_t page = 0; page < num_pages; ++page)
    bytes.push_back(page * kPageBytes + 100 + rng.Below(kPageBytes - 100));
  for (const size_t byte : bytes) {
    const int bit = static_cast<int>(rng.Below(8));
    SCOPED_TRACE(fmt::format("byte {} bit {}", byte, bit));
    FlipBit(file_, byte, bit);
    if (byte / kPageBytes == 1) {
      // The pointer map, which only writers and checks read.
      const auto reader = Open(file_, Connection::Mode::kReadOnly);
      Statement check = reader->Prepare("PRAGMA integrity_check");
      Value(check.Step());
      EXPECT_NE(check.Bytes(0), "ok");
      EXPECT_EQ(LastDamagedPage(reader->handle()), 2U);
    } else {
      const auto damaged = Content();
      EXPECT_THAT(damaged, HasCode(StatusCode::kDataLoss));
      EXPECT_THAT(std::string(damaged.status().message()),
                  HasSubstr(fmt::format("page {} of t.db is damaged", byte / kPageBytes + 1)));
      EXPECT_THAT(std::string(damaged.status().message()), Not(HasSubstr(folder_.path().string())));
    }
    FlipBit(file_, byte, bit);
  }
  EXPECT_EQ(Value(Content()), content);
}

TEST_F(ChecksumVfsTest, DamageToTheHeaderOfAnOpenFileDoesNotEndTheChecks) {
  const auto db = Create("WAL");
  Insert(*db, 0, 60);
  Value(db->QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)"));
  for (const auto& [byte, bit] : {std::pair(kReservedBytesOffset, 3), std::pair(size_t{16}, 4)}) {
    FlipBit(file_, byte, bit);
    // In place, without the first page, which would be written whole and sound.
    Check(db->Prepare("UPDATE t SET value = randomblob(length(value)) WHERE id = 20").Run());
    Value(db->QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)"));
    FlipBit(file_, byte, bit);
    ExpectSealed();
  }
  EXPECT_THAT(Value(Content()), HasSubstr("row 20"));
}

TEST_F(ChecksumVfsTest, APageInAnothersPlaceIsDamage) {
  auto db = Create("WAL");
  Insert(*db, 0, 60);
  db.reset();
  std::string bytes = ReadFile(file_);
  std::copy_n(bytes.begin() + 9 * kPageBytes, kPageBytes, bytes.begin() + 12 * kPageBytes);
  std::ofstream(file_, std::ios::binary) << bytes;
  const auto content = Content();
  EXPECT_THAT(content, HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(content.status().message()), HasSubstr("page 13 of"));
}

TEST_F(ChecksumVfsTest, AHoleThatWasNeverWrittenIsNoDamage) {
  auto db = Create("WAL");
  // Pages that are allocated and freed again in one transaction are not written, but those behind them are.
  Check(db->Execute(
      "BEGIN; CREATE TABLE gone (value BLOB); INSERT INTO gone VALUES (zeroblob(400000));"
      "CREATE TABLE last (value BLOB); INSERT INTO last VALUES (zeroblob(9000)); DROP TABLE gone; COMMIT;"));
  db.reset();
  const std::string bytes = ReadFile(file_);
  const std::string hole(kPageBytes, '\0');
  int num_holes = 0;
  for (size_t page = 0; page < bytes.size() / kPageBytes; ++page) {
    num_holes += bytes.compare(page * kPageBytes, kPageBytes, hole) == 0;
  }
  EXPECT_GT(num_holes, 0) << "tests nothing";
  db = Open(file_);
  Insert(*db, 0, 100);
  ExpectSound(*db);
  Check(db->Execute("DELETE FROM t; PRAGMA incremental_vacuum; VACUUM;"));
  ExpectSound(*db);
}

TEST_F(ChecksumVfsTest, VacuumsKeepTheChecksums) {
  auto db = Create("WAL");
  Insert(*db, 0, 300);
  Check(db->Execute("DELETE FROM t WHERE id < 200; PRAGMA incremental_vacuum(20);"));
  db.reset();
  ExpectSealed();
  db = Open(file_);
  Check(db->Execute("PRAGMA incremental_vacuum; VACUUM;"));
  db.reset();
  ExpectSealed();
  // In rollback modes SQLite could change the page size.
  for (const int page_bytes : {1024, 8192}) {
    db = Open(file_);
    Check(db->Execute("PRAGMA journal_mode = DELETE; PRAGMA cache_size = 10;"));
    Check(db->Execute(fmt::format("PRAGMA page_size = {}; VACUUM;", page_bytes)));
    EXPECT_EQ(Value(db->QueryInt64("PRAGMA page_size")), kPageBytes);
    ExpectSound(*db);
    db.reset();
    ExpectSealed();
  }
  EXPECT_EQ(Value(Open(file_)->QueryInt64("SELECT count(*) FROM t WHERE length(value) > 0")), 100);
}

TEST_F(ChecksumVfsTest, RolledBackPagesAreSealed) {
  auto db = Create("DELETE");
  Insert(*db, 0, 100);
  Check(db->Execute("PRAGMA cache_size = 10; BEGIN; UPDATE t SET value = zeroblob(5000); ROLLBACK;"));
  ExpectSound(*db);
  db.reset();
  ExpectSealed();
  EXPECT_THAT(Value(Content()), HasSubstr("row 99"));
}

TEST_F(ChecksumVfsTest, WhatAKillLeavesIsNoDamage) {
  for (const char* journal : {"WAL", "DELETE"}) {
    SCOPED_TRACE(journal);
    Create(journal).reset();
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      const auto db = Open(file_);
      Check(db->Execute("PRAGMA cache_size = 10; PRAGMA wal_autocheckpoint = 20;"));
      Insert(*db, 0, 200);
      // Killed inside a transaction, whose pages are in the file with a rollback journal.
      Check(db->Execute("BEGIN; UPDATE t SET value = zeroblob(3000);"));
      if (write(ends[1], "x", 1) != 1) std::abort();
      pause();
    }
    char told = 0;
    ASSERT_EQ(read(ends[0], &told, 1), 1);
    kill(child, SIGKILL);
    int how = 0;
    ASSERT_EQ(waitpid(child, &how, 0), child);
    close(ends[0]);
    close(ends[1]);
    auto db = Open(file_);
    ExpectSound(*db);
    EXPECT_EQ(Value(db->QueryInt64("SELECT count(*) FROM t WHERE value <> zeroblob(3000)")), 200);
    db.reset();
    ExpectSealed();
    std::filesystem::remove(file_);
  }
}

TEST_F(ChecksumVfsTest, ADatabaseWithoutChecksumsIsReadAndWrittenUnchecked) {
  auto db = Create("WAL", /*with_checksums=*/false);
  Insert(*db, 0, 100);
  EXPECT_FALSE(HasChecksums(*db));
  db.reset();
  db = Open(file_);
  Check(db->Execute("DELETE FROM t WHERE id < 50; VACUUM;"));
  ExpectSound(*db);
  EXPECT_FALSE(HasChecksums(*db));
  db.reset();
  EXPECT_EQ(ReadFile(file_)[kReservedBytesOffset], 0);
}

TEST_F(ChecksumVfsTest, EnableChecksumsSealsADatabaseOfBefore) {
  auto db = Create("WAL", /*with_checksums=*/false);
  Insert(*db, 0, 300);
  const auto reader = Open(file_, Connection::Mode::kReadOnly);
  EXPECT_EQ(Value(reader->QueryInt64("SELECT count(*) FROM t")), 300);
  const std::string content = Value(Content());
  Check(db->Execute("PRAGMA cache_size = 10;"));
  Check(EnableChecksums(*db));
  EXPECT_TRUE(HasChecksums(*db));
  ExpectSealed();
  // Who had it open goes on, and writes what others find sound.
  EXPECT_EQ(Value(reader->QueryInt64("SELECT count(*) FROM t WHERE length(value) > 0")), 300);
  Insert(*db, 300, 50);
  Check(EnableChecksums(*db));
  ExpectSound(*db);
  Check(db->Execute("DELETE FROM t WHERE id >= 300; PRAGMA wal_checkpoint(TRUNCATE);"));
  EXPECT_EQ(Value(Content()), content);
  ExpectSealed();
}

TEST_F(ChecksumVfsTest, AConnectionThatKnewTheFileBeforeSealsWhatItWrites) {
  auto db = Create("WAL", /*with_checksums=*/false);
  Insert(*db, 0, 100);
  const auto other = Open(file_, Connection::Mode::kReadWrite);
  EXPECT_EQ(Value(other->QueryInt64("SELECT count(*) FROM t")), 100);
  Check(EnableChecksums(*db));
  Insert(*other, 100, 50);
  Value(other->QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)"));
  ExpectSealed();
  ExpectSound(*db);
}

TEST_F(ChecksumVfsTest, EnableChecksumsKeepsTheMapsOfAGoldenDatabase) {
  std::filesystem::copy_file(GoldenDatabaseFile(1), file_);
  {
    const auto store = Value(OpenSqliteMapStore(file_, {.backup_before_migration = false}));
    ExpectGoldenContent(*Value(store->Read()));
    Check(store->Close());
  }
  Check(EnableChecksums(*Open(file_, Connection::Mode::kReadWrite)));
  ExpectSealed(static_cast<size_t>(Value(Open(file_)->QueryInt64("PRAGMA page_size"))));
  const auto store = Value(OpenSqliteMapStore(file_, {}));
  ExpectGoldenContent(*Value(store->Read()));
}

}  // namespace
}  // namespace mapp::sqlite
