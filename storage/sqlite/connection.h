#pragma once

#include "mapp/base/status.h"
#include "storage/sqlite/statement.h"

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>

struct sqlite3;

namespace mapp::sqlite {

/// One SQLite connection with its prepared statements. One thread at a time.
class Connection {
 public:
  enum class Mode { kReadOnly, kReadWrite, kCreate };

  static StatusOr<std::unique_ptr<Connection>> Open(const std::string& file, Mode mode,
                                                    std::chrono::milliseconds busy_timeout);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// Compiled at the first use of `sql` and kept. The same text must not be prepared again while in use.
  Statement Prepare(std::string_view sql);
  /// Runs a script of statements, rows ignored.
  Status Execute(const std::string& script);
  /// The single integer that `sql` answers (a pragma, a count); NOT_FOUND without a row.
  StatusOr<int64_t> QueryInt64(std::string_view sql);

  int64_t last_insert_id() const;
  /// Rows that the statement which ran last has inserted, changed or deleted.
  int64_t num_changed() const;
  /// Whether a transaction is open. Some errors (a full disk) end it behind the program's back.
  bool in_transaction() const;
  sqlite3* handle() const { return db_; }

 private:
  struct Cached {
    sqlite3_stmt* statement = nullptr;
    bool in_use = false;
  };
  /// Lets a string_view find a string without a copy.
  struct TextHash {
    using is_transparent = void;
    size_t operator()(std::string_view text) const { return std::hash<std::string_view>{}(text); }
  };

  explicit Connection(sqlite3* db) : db_(db) {}

  sqlite3* db_;
  std::unordered_map<std::string, Cached, TextHash, std::equal_to<>> statements_;  ///< by their text
};

/// A transaction, rolled back unless committed.
class Transaction {
 public:
  /// kSnapshot sees one state of the database and writes nothing; kWrite takes the write lock at once.
  enum class Kind { kSnapshot, kWrite };

  static StatusOr<std::unique_ptr<Transaction>> Begin(Connection& db, Kind kind);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;

  /// When it fails, everything is rolled back.
  Status Commit();

 private:
  explicit Transaction(Connection& db) : db_(db) {}

  Connection& db_;
};

/// A part of a transaction that is undone alone unless released.
class Savepoint {
 public:
  static StatusOr<std::unique_ptr<Savepoint>> Begin(Connection& db);
  ~Savepoint();
  Savepoint(const Savepoint&) = delete;
  Savepoint& operator=(const Savepoint&) = delete;

  Status Release();

 private:
  explicit Savepoint(Connection& db) : db_(db) {}

  Connection& db_;
  bool released_ = false;
};

}  // namespace mapp::sqlite
