#include "storage/sqlite/statement.h"

#include "storage/sqlite/errors.h"

#include <sqlite3.h>

#include <utility>

namespace mapp::sqlite {

Statement::Statement(sqlite3* db, sqlite3_stmt* statement, int prepare_code, bool* in_use)
    : db_(db), statement_(statement), code_(prepare_code), in_use_(in_use) {}

Statement::Statement(Statement&& other) noexcept
    : db_(other.db_),
      statement_(std::exchange(other.statement_, nullptr)),
      code_(other.code_),
      in_use_(std::exchange(other.in_use_, nullptr)),
      num_bound_(other.num_bound_) {}

Statement::~Statement() {
  Reset();
  if (in_use_ != nullptr) *in_use_ = false;
}

Statement& Statement::Reset() {
  if (statement_ != nullptr) {
    // The code repeats the last Step's error, which that Step has returned.
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
  }
  num_bound_ = 0;
  return *this;
}

StatusOr<bool> Statement::Step() {
  if (code_ == SQLITE_OK) code_ = sqlite3_step(statement_);
  switch (code_) {
    case SQLITE_ROW:
      code_ = SQLITE_OK;
      return true;
    case SQLITE_DONE:
      code_ = SQLITE_OK;
      return false;
    default:
      return SqliteError(code_, "map database", db_);
  }
}

Status Statement::Run() {
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, Step());
    if (!has_row) return absl::OkStatus();
  }
}

bool Statement::IsNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
int64_t Statement::Int64(int column) const { return sqlite3_column_int64(statement_, column); }
double Statement::Double(int column) const { return sqlite3_column_double(statement_, column); }

std::string_view Statement::Bytes(int column) const {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement_, column));
  return {bytes, static_cast<size_t>(sqlite3_column_bytes(statement_, column))};
}

void Statement::BindNull() {
  // Parameters are NULL until bound.
  ++num_bound_;
}

void Statement::BindInt64(int64_t value) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_int64(statement_, ++num_bound_, value);
}

void Statement::BindDouble(double value) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_double(statement_, ++num_bound_, value);
}

void Statement::BindText(std::string_view text) {
  if (code_ != SQLITE_OK) return;
  // Static: the caller keeps the text until the statement is gone (see Bind).
  code_ = sqlite3_bind_text64(statement_, ++num_bound_, text.data(), text.size(), SQLITE_STATIC, SQLITE_UTF8);
}

void Statement::BindBlob(std::string_view bytes) {
  if (code_ != SQLITE_OK) return;
  // A null pointer would bind NULL instead of an empty blob.
  const char* data = bytes.empty() ? "" : bytes.data();
  code_ = sqlite3_bind_blob64(statement_, ++num_bound_, data, bytes.size(), SQLITE_STATIC);
}

}  // namespace mapp::sqlite
