#pragma once

#include "mapp/base/status.h"
#include "storage/sqlite/connection.h"
#include "storage/verify.h"

#include <functional>
#include <string>
#include <vector>

namespace mapp::sqlite {

/// What is wrong with a row, one finding a line; empty when nothing is. An error: the database cannot tell.
using Fault = std::function<StatusOr<std::string>(Connection& db, const Statement& row)>;

/// One kind of violation, looked for in one pass over the rows of a query.
struct VerifyCheck {
  std::string name;
  std::string what;  ///< Violation::what
  /// Column 0 is Violation::id. Without `fault` every row is a violation and column 1 its message.
  std::string sql;
  Fault fault = {};
};

std::vector<VerifyCheck> FileChecks();
std::vector<VerifyCheck> CatalogChecks(const VerifyOptions& options);
std::vector<VerifyCheck> FrameChecks();
std::vector<VerifyCheck> PointChecks();
std::vector<VerifyCheck> TileChecks();
std::vector<VerifyCheck> ChangeChecks();

}  // namespace mapp::sqlite
