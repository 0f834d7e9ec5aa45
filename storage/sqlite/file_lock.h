#pragma once

#include "mapp/base/status.h"

#include <memory>
#include <string>

namespace mapp::sqlite {

/// An exclusive claim on a database file, held through flock on `FILE.lock` beside it; the kernel ends it with the
/// process, however that dies. (Not on the database itself: closing any descriptor of that file would drop the locks
/// that SQLite holds in this process.) The file stays behind, as removing it would race with the next owner.
class FileLock {
 public:
  /// FAILED_PRECONDITION when another store holds it (the message names the process) or the folder cannot be written;
  /// NOT_FOUND when the folder does not exist.
  static StatusOr<std::unique_ptr<FileLock>> Acquire(const std::string& file);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  explicit FileLock(int descriptor) : descriptor_(descriptor) {}

  int descriptor_;
};

}  // namespace mapp::sqlite
