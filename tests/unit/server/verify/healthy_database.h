#pragma once

#include "storage/verify.h"

#include <string>

namespace mapp::testing {

/// A closed database that a real service has written: a founder's round, a session that was aligned, one that was
/// taken out again, a fragment, an optimization, a tag, tiles as they were sent. Made once a process.
const std::string& HealthyDatabase();

/// VerifyDatabase with the check of place blocks; a violation of its own when it fails.
StatusOr<VerifyReport> Verify(const std::string& file, int max_listed = 100);

/// A line each, for messages of tests.
std::string Describe(const VerifyReport& report);

/// A copy of the healthy database.
class DatabaseCopy {
 public:
  DatabaseCopy();
  ~DatabaseCopy();
  DatabaseCopy(const DatabaseCopy&) = delete;
  DatabaseCopy& operator=(const DatabaseCopy&) = delete;

  const std::string& file() const { return file_; }
  /// Without foreign keys, nor anything else that keeps one from it.
  void RunSql(const std::string& sql) const;

 private:
  std::string folder_;
  std::string file_;
};

}  // namespace mapp::testing
