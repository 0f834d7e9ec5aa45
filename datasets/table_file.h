#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// One line of a list that is neither blank nor a comment.
struct TableRow {
  int line = 0;  ///< counted from 1
  std::vector<std::string> fields;
};

/// Reads a text list whose fields are separated by `separator` (' ' stands for any run of blanks). Lines that begin
/// with '#' are comments; fields are trimmed, and a final CR is no part of the line.
/// NOT_FOUND: no such file. DATA_LOSS: it cannot be read. INVALID_ARGUMENT ("file:line: ..."): a line that has fewer
/// than `min_fields` fields.
StatusOr<std::vector<TableRow>> ReadTable(const std::string& file, char separator, size_t min_fields);

/// INVALID_ARGUMENT "file:line: problem".
Status BadLine(const std::string& file, int line, const std::string& problem);

/// A finite number, all of the text; nullopt otherwise.
std::optional<double> ParseNumber(std::string_view text);
/// Whole nanoseconds, as EuRoC lists write times.
std::optional<int64_t> ParseNanoseconds(std::string_view text);
/// Decimal seconds to nanoseconds without passing through a double, which is too coarse for times since 1970.
/// Digits beyond the ninth decimal are dropped. Range [0, 9e9] s.
std::optional<int64_t> ParseSeconds(std::string_view text);

}  // namespace mapp
