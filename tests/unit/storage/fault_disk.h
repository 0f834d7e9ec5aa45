#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/rng.h"

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <utility>
#include <vector>

namespace mapp {

/// What goes wrong with a disk, and at which of its operations (opening, reading, writing, truncating, syncing, asking
/// for a size, deleting, renaming).
struct DiskFault {
  enum class Kind {
    kNone,
    kFail,        ///< the operation fails; the writes before a sync that fails are kept or lost, each for itself
    kFailFrom,    ///< so do all that follow, until Heal()
    kFull,        ///< writes find no room from there on, until Heal()
    kShortWrite,  ///< the next write stops half-way, and so does the machine
    kPowerCut,    ///< the machine stops: every operation fails until Reboot()
  };
  Kind kind = Kind::kNone;
  int64_t at = 0;              ///< the operation's number, from 0
  bool ignores_syncs = false;  ///< a disk that lies
  uint64_t seed = 1;           ///< of what chance decides
};

/// A model of a disk: what of the files in a folder would be there after a power cut. The files themselves hold what
/// the running system sees. Writes and truncations count as kept once their file is synced, names once the folder is.
/// Of the others a power cut keeps any, a write in any of its 512-byte sectors; names change in order. Thread-safe.
class FaultDisk {
 public:
  enum class Error { kNone, kIo, kFull };
  class Inode;
  using File = std::shared_ptr<Inode>;

  /// A disk with what is in `folder`, without a fault.
  void Start(const std::string& folder);
  /// Counts operations from here on.
  void Insert(const DiskFault& fault);
  void Heal();
  void CutPower();
  /// Makes the files what the disk kept. Nobody has any of them open.
  void Reboot();

  int64_t num_operations();
  /// What they were, while there was no fault: "write maps.db-wal".
  std::vector<std::string> operations();
  /// Of files, that succeeded.
  int64_t num_syncs();
  bool is_off();
  /// The operation that went wrong first, for messages; empty when none has.
  std::string struck();

  // What the system calls on the way to the files. An operation that fails is not to be passed on.
  Error Open(const std::string& name);
  /// The file of that name, which has been opened.
  File Opened(const std::string& name);
  Error Remove(const std::string& name);
  /// Somebody has removed it past the disk.
  void Removed(const std::string& name);
  Error Rename(const std::string& from, const std::string& to);
  Error SyncNames();
  /// The file that an open descriptor stands for; null when it is not of this disk.
  File Find(dev_t device, ino_t id);

  // `file` is null for one that nobody will miss after a power cut.
  Error Read(const File& file);
  /// `*num_bytes`: how many reach the file, also when the write fails.
  Error Write(const File& file, int64_t offset, std::string_view bytes, size_t* num_bytes);
  Error Truncate(const File& file, int64_t size);
  Error Sync(const File& file);

 private:
  /// One atomic change of the folder: names and what they stand for, null for nothing.
  using NameChange = std::vector<std::pair<std::string, File>>;

  std::string Describe(const char* what, const std::string& name) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Error Operate(const char* what, const std::string& name) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Strike(const char* what, const std::string& name) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ChangeNames(NameChange change) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// The file's pending writes, each kept or lost.
  void KeepSome(Inode& file) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Mutex mutex_;
  std::string folder_ ABSL_GUARDED_BY(mutex_);
  DiskFault fault_ ABSL_GUARDED_BY(mutex_);
  Rng rng_ ABSL_GUARDED_BY(mutex_){1};
  int64_t num_operations_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<std::string> operations_ ABSL_GUARDED_BY(mutex_);
  int64_t num_syncs_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string struck_ ABSL_GUARDED_BY(mutex_);
  bool is_off_ ABSL_GUARDED_BY(mutex_) = false;
  bool keeps_all_ ABSL_GUARDED_BY(mutex_) = false;  ///< what is pending when the power goes
  std::map<std::string, File> names_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, File> kept_names_ ABSL_GUARDED_BY(mutex_);
  std::vector<NameChange> pending_names_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
