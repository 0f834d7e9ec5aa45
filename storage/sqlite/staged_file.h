#pragma once

#include "mapp/base/status.h"

#include <memory>
#include <string>

namespace mapp::sqlite {

/// A file that appears whole or not at all: it is written as `FILE.unfinished` and renamed when it is on disk. Without
/// Commit() it is removed again; a process that is killed leaves `FILE.unfinished`, which the next attempt takes over.
class StagedFile {
 public:
  /// Claims `target.unfinished`, empty, for its owner alone to read. FAILED_PRECONDITION: somebody else is writing it,
  /// or the folder cannot be written. NOT_FOUND: there is no such folder.
  static StatusOr<std::unique_ptr<StagedFile>> Create(const std::string& target);
  ~StagedFile();
  StagedFile(const StagedFile&) = delete;
  StagedFile& operator=(const StagedFile&) = delete;

  /// Where to write. Who has opened it closes it before Commit.
  const std::string& path() const { return path_; }
  const std::string& target() const { return target_; }

  /// Who may read and write `file` may do so with this one.
  Status TakePermissions(const std::string& file);
  /// Also belongs to whom `file` belongs, as far as this process may give it away.
  Status TakeOwner(const std::string& file);

  /// Waits until the disk has what was written, as Commit() does: for whom there is something to do between the two.
  Status Sync();
  enum class Existing { kRefuse, kReplace };
  /// Puts it in its place, durably. ALREADY_EXISTS: something is there and is not to be replaced.
  Status Commit(Existing existing);

 private:
  StagedFile(std::string target, std::string path, int descriptor);

  const std::string target_;
  const std::string path_;
  const int descriptor_;  ///< holds the claim
  bool committed_ = false;
};

/// Makes what was renamed, linked or removed in `folder` durable.
Status SyncFolder(const std::string& folder);

/// What SQLite puts beside a database while it is open, or leaves there when it is killed.
inline constexpr const char* kWalSuffix = "-wal";
inline constexpr const char* kJournalSuffix = "-journal";
inline constexpr const char* kSharedMemorySuffix = "-shm";

}  // namespace mapp::sqlite
