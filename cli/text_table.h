#pragma once

#include <string>
#include <vector>

namespace mapp {

enum class Align { kLeft, kRight };

/// Rows of text in columns as wide as their widest cell, two spaces apart, for people to read.
class TextTable {
 public:
  struct Column {
    std::string title;
    Align align = Align::kLeft;
  };

  explicit TextTable(std::vector<Column> columns) : columns_(std::move(columns)) {}
  /// One cell a column.
  void AddRow(std::vector<std::string> cells);
  /// The titles and the rows, each line ending in a newline and without trailing spaces.
  std::string Format() const;

 private:
  std::vector<Column> columns_;
  std::vector<std::vector<std::string>> rows_;
};

/// `2026-07-31 12:04:05` (UTC) for a Unix time in nanoseconds; `-` for 0.
std::string FormatUnixTime(int64_t unix_ns);
/// `812 B`, `40.3 KB`, `1.2 MB` (decimal).
std::string FormatBytes(double bytes);

}  // namespace mapp
