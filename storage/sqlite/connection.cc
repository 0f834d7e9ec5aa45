#include "storage/sqlite/connection.h"

#include "mapp/base/check.h"
#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/errors.h"

#include <sqlite3.h>

namespace mapp::sqlite {
namespace {

int OpenFlags(Connection::Mode mode) {
  // NOMUTEX: a connection is used by one thread at a time. EXRESCODE: errors tell more than "I/O error".
  const int common = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  switch (mode) {
    case Connection::Mode::kReadOnly:
      return common | SQLITE_OPEN_READONLY;
    case Connection::Mode::kReadWrite:
      return common | SQLITE_OPEN_READWRITE;
    case Connection::Mode::kCreate:
      return common | SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  }
  return common;
}

}  // namespace

StatusOr<std::unique_ptr<Connection>> Connection::Open(const std::string& file, Mode mode,
                                                       std::chrono::milliseconds busy_timeout) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(file.c_str(), &db, OpenFlags(mode), ChecksumVfsName());
  // Owned from here on, as SQLite gives a handle to be closed even when opening fails.
  std::unique_ptr<Connection> connection(new Connection(db));
  if (code != SQLITE_OK) return SqliteError(code, "open", db);
  sqlite3_busy_timeout(db, static_cast<int>(busy_timeout.count()));
  // A database that somebody has tampered with must not run functions or overwrite its own schema through us.
  sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  return connection;
}

Connection::~Connection() {
  for (auto& [sql, cached] : statements_) sqlite3_finalize(cached.statement);
  // Cannot fail: every statement is finalized, and nobody else makes any on this handle.
  sqlite3_close(db_);
}

Statement Connection::Prepare(std::string_view sql) {
  if (const auto found = statements_.find(sql); found != statements_.end()) {
    Cached& cached = found->second;
    MAPP_CHECK(!cached.in_use);
    cached.in_use = true;
    return Statement(db_, cached.statement, SQLITE_OK, &cached.in_use);
  }
  sqlite3_stmt* statement = nullptr;
  const int code =
      sqlite3_prepare_v3(db_, sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT, &statement, nullptr);
  if (code != SQLITE_OK) return Statement(db_, nullptr, code, nullptr);
  Cached& cached = statements_[std::string(sql)];
  cached = {.statement = statement, .in_use = true};
  return Statement(db_, statement, SQLITE_OK, &cached.in_use);
}

Status Connection::Execute(const std::string& script) {
  const int code = sqlite3_exec(db_, script.c_str(), nullptr, nullptr, nullptr);
  return SqliteError(code, "map database", db_);
}

StatusOr<int64_t> Connection::QueryInt64(std::string_view sql) {
  Statement statement = Prepare(sql);
  MAPP_ASSIGN_OR_RETURN(const bool has_row, statement.Step());
  if (!has_row) return absl::NotFoundError("map database: no row");
  return statement.Int64(0);
}

int64_t Connection::last_insert_id() const { return sqlite3_last_insert_rowid(db_); }
int64_t Connection::num_changed() const { return sqlite3_changes64(db_); }
bool Connection::in_transaction() const { return sqlite3_get_autocommit(db_) == 0; }

StatusOr<std::unique_ptr<Transaction>> Transaction::Begin(Connection& db, Kind kind) {
  MAPP_RETURN_IF_ERROR(db.Prepare(kind == Kind::kWrite ? "BEGIN IMMEDIATE" : "BEGIN DEFERRED").Run());
  std::unique_ptr<Transaction> transaction(new Transaction(db));
  if (kind == Kind::kSnapshot) {
    // BEGIN alone takes no snapshot; the first read does.
    MAPP_RETURN_IF_ERROR(db.QueryInt64("SELECT count(*) FROM sqlite_schema").status());
  } else {
    // Should an error end the transaction before Commit, what follows must not commit statement by statement.
    sqlite3_commit_hook(
        db.handle(), [](void*) { return 1; }, nullptr);
  }
  return transaction;
}

Transaction::~Transaction() {
  sqlite3_commit_hook(db_.handle(), nullptr, nullptr);
  // No transaction is left after a commit, nor after an error that made SQLite roll back by itself. Should ROLLBACK
  // fail, the transaction stays open and the next BEGIN reports it.
  if (db_.in_transaction()) db_.Prepare("ROLLBACK").Run().IgnoreError();
}

Status Transaction::Commit() {
  sqlite3_commit_hook(db_.handle(), nullptr, nullptr);
  Status status = db_.Prepare("COMMIT").Run();
  if (!status.ok() && db_.in_transaction()) db_.Prepare("ROLLBACK").Run().IgnoreError();
  return status;
}

StatusOr<std::unique_ptr<Savepoint>> Savepoint::Begin(Connection& db) {
  MAPP_RETURN_IF_ERROR(db.Prepare("SAVEPOINT change").Run());
  return std::unique_ptr<Savepoint>(new Savepoint(db));
}

Savepoint::~Savepoint() {
  // Gone with the transaction when an error ended that.
  if (released_ || !db_.in_transaction()) return;
  db_.Prepare("ROLLBACK TO change").Run().IgnoreError();
  db_.Prepare("RELEASE change").Run().IgnoreError();
}

Status Savepoint::Release() {
  MAPP_RETURN_IF_ERROR(db_.Prepare("RELEASE change").Run());
  released_ = true;
  return absl::OkStatus();
}

}  // namespace mapp::sqlite
