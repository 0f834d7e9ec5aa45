#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

struct sqlite3;
struct sqlite3_stmt;

namespace mapp::sqlite {

/// Marks bytes to be bound as a BLOB; a string_view by itself is TEXT.
struct Blob {
  std::string_view bytes;
};

/// A prepared statement borrowed from its Connection; gives it back reset and without bindings. An error of preparing
/// or binding is kept and returned by the next Step or Run, so that calls chain: `db.Prepare(sql).Bind(a, b).Run()`.
/// One thread at a time.
class Statement {
 public:
  /// `prepare_code` is what sqlite3_prepare returned; `statement` may be null then. `in_use` is cleared at the end.
  Statement(sqlite3* db, sqlite3_stmt* statement, int prepare_code, bool* in_use);
  Statement(Statement&& other) noexcept;
  Statement& operator=(Statement&&) = delete;
  ~Statement();

  /// Binds the next parameters in order: integers, floating point, bool, Id, string_view (TEXT), Blob, and optionals
  /// of these (NULL when empty). Text and blobs are not copied: they must live until the statement is gone.
  template <typename... Values>
  Statement& Bind(const Values&... values) {
    (BindOne(values), ...);
    return *this;
  }
  /// Makes the statement ready to be bound and run again.
  Statement& Reset();

  /// True when there is a row to read, false at the end.
  StatusOr<bool> Step();
  /// Runs to the end, rows ignored.
  Status Run();

  bool IsNull(int column) const;
  int64_t Int64(int column) const;
  double Double(int column) const;
  /// Text or blob as stored; valid until the next Step, Reset or destruction.
  std::string_view Bytes(int column) const;
  template <typename IdType>
  IdType GetId(int column) const {
    return IdType(static_cast<uint64_t>(Int64(column)));
  }

 private:
  template <typename T>
  void BindOne(const T& value) {
    if constexpr (std::is_same_v<T, Blob>) {
      BindBlob(value.bytes);
    } else if constexpr (std::is_convertible_v<T, std::string_view>) {
      BindText(value);
    } else if constexpr (std::is_floating_point_v<T>) {
      BindDouble(value);
    } else if constexpr (std::is_integral_v<T>) {
      BindInt64(static_cast<int64_t>(value));
    } else {
      BindInt64(static_cast<int64_t>(value.value()));
    }
  }
  template <typename T>
  void BindOne(const std::optional<T>& value) {
    if (value) {
      BindOne(*value);
    } else {
      BindNull();
    }
  }
  void BindNull();
  void BindInt64(int64_t value);
  void BindDouble(double value);
  void BindText(std::string_view text);
  void BindBlob(std::string_view bytes);

  sqlite3* db_;
  sqlite3_stmt* statement_;
  int code_;  ///< first error so far
  bool* in_use_;
  int num_bound_ = 0;
};

}  // namespace mapp::sqlite
