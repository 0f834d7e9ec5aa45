#include "tests/unit/storage/fault_vfs.h"

#include <sqlite3.h>

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <new>
#include <string>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>

namespace mapp {
namespace {

using Error = FaultDisk::Error;

FaultDisk& Disk() {
  static FaultDisk& disk = *new FaultDisk();  // for as long as SQLite may call
  return disk;
}

int ToCode(Error error, int io_code) {
  switch (error) {
    case Error::kNone:
      return SQLITE_OK;
    case Error::kIo:
      return io_code;
    case Error::kFull:
      return SQLITE_FULL;
  }
  return SQLITE_INTERNAL;
}

/// SQLite allocates it, with the system's own file behind it.
class DiskFile {
 public:
  explicit DiskFile(const sqlite3_io_methods* methods) { base_.pMethods = methods; }
  static DiskFile& From(sqlite3_file* file) { return *reinterpret_cast<DiskFile*>(file); }
  sqlite3_file* inner() { return reinterpret_cast<sqlite3_file*>(this + 1); }
  const sqlite3_io_methods& methods() { return *inner()->pMethods; }

  void Opened(FaultDisk::File file, bool is_new_journal) {
    file_ = std::move(file);
    syncs_names_ = is_new_journal;
  }

  int Read(void* buffer, int num_bytes, sqlite3_int64 offset) {
    const int code = ToCode(Disk().Read(file_), SQLITE_IOERR_READ);
    return code == SQLITE_OK ? methods().xRead(inner(), buffer, num_bytes, offset) : code;
  }
  int Write(const void* buffer, int num_bytes, sqlite3_int64 offset) {
    size_t num_written = 0;
    const std::string_view bytes(static_cast<const char*>(buffer), static_cast<size_t>(num_bytes));
    const int code = ToCode(Disk().Write(file_, offset, bytes, &num_written), SQLITE_IOERR_WRITE);
    if (num_written == 0) return code;
    const int inner_code = methods().xWrite(inner(), buffer, static_cast<int>(num_written), offset);
    return code == SQLITE_OK ? inner_code : code;
  }
  int Truncate(sqlite3_int64 size) {
    const int code = ToCode(Disk().Truncate(file_, size), SQLITE_IOERR_TRUNCATE);
    return code == SQLITE_OK ? methods().xTruncate(inner(), size) : code;
  }
  /// The files need no syncing: it is the disk that says what is kept.
  int Sync() {
    if (const int code = ToCode(Disk().Sync(file_), SQLITE_IOERR_FSYNC); code != SQLITE_OK) return code;
    // As SQLite's own VFS does with journals and logs that it has created, and with no other file.
    if (!syncs_names_) return SQLITE_OK;
    const int code = ToCode(Disk().SyncNames(), SQLITE_IOERR_DIR_FSYNC);
    syncs_names_ = code != SQLITE_OK;
    return code;
  }
  int Size(sqlite3_int64* size) {
    const int code = ToCode(Disk().Read(file_), SQLITE_IOERR_FSTAT);
    return code == SQLITE_OK ? methods().xFileSize(inner(), size) : code;
  }

 private:
  sqlite3_file base_{};  ///< first: what SQLite sees
  FaultDisk::File file_;
  bool syncs_names_ = false;
};
static_assert(sizeof(DiskFile) % 8 == 0, "the system's file behind it must be aligned");

int Close(sqlite3_file* file) {
  DiskFile& ours = DiskFile::From(file);
  const int code = ours.methods().xClose(ours.inner());
  ours.~DiskFile();
  return code;
}

constexpr sqlite3_io_methods kDiskMethods = {
    .iVersion = 2,
    .xClose = Close,
    .xRead = [](sqlite3_file* file, void* buffer, int num_bytes,
                sqlite3_int64 offset) { return DiskFile::From(file).Read(buffer, num_bytes, offset); },
    .xWrite = [](sqlite3_file* file, const void* buffer, int num_bytes,
                 sqlite3_int64 offset) { return DiskFile::From(file).Write(buffer, num_bytes, offset); },
    .xTruncate = [](sqlite3_file* file, sqlite3_int64 size) { return DiskFile::From(file).Truncate(size); },
    .xSync = [](sqlite3_file* file, int) { return DiskFile::From(file).Sync(); },
    .xFileSize = [](sqlite3_file* file, sqlite3_int64* size) { return DiskFile::From(file).Size(size); },
    .xLock =
        [](sqlite3_file* file, int lock) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xLock(ours.inner(), lock);
        },
    .xUnlock =
        [](sqlite3_file* file, int lock) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xUnlock(ours.inner(), lock);
        },
    .xCheckReservedLock =
        [](sqlite3_file* file, int* result) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xCheckReservedLock(ours.inner(), result);
        },
    .xFileControl =
        [](sqlite3_file* file, int operation, void* argument) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xFileControl(ours.inner(), operation, argument);
        },
    .xSectorSize =
        [](sqlite3_file* file) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xSectorSize(ours.inner());
        },
    .xDeviceCharacteristics =
        [](sqlite3_file* file) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xDeviceCharacteristics(ours.inner());
        },
    .xShmMap =
        [](sqlite3_file* file, int region, int num_bytes, int extend, void volatile** memory) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xShmMap(ours.inner(), region, num_bytes, extend, memory);
        },
    .xShmLock =
        [](sqlite3_file* file, int offset, int count, int flags) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xShmLock(ours.inner(), offset, count, flags);
        },
    .xShmBarrier =
        [](sqlite3_file* file) {
          DiskFile& ours = DiskFile::From(file);
          ours.methods().xShmBarrier(ours.inner());
        },
    .xShmUnmap =
        [](sqlite3_file* file, int remove) {
          DiskFile& ours = DiskFile::From(file);
          return ours.methods().xShmUnmap(ours.inner(), remove);
        },
    .xFetch = nullptr,
    .xUnfetch = nullptr,
};

/// What is copied from it calls with a pointer to the copy: nothing may be looked for behind it.
struct DiskVfs {
  DiskVfs() : system(sqlite3_vfs_find(nullptr)), vfs(*system) {
    vfs.pNext = nullptr;
    vfs.zName = "fault-disk";
    vfs.szOsFile = static_cast<int>(sizeof(DiskFile)) + system->szOsFile;
    vfs.xOpen = OpenFile;
    vfs.xDelete = DeleteFile;
    sqlite3_vfs_register(&vfs, /*makeDflt=*/1);
  }

  static DiskVfs& Get() {
    static DiskVfs& vfs = *new DiskVfs();
    return vfs;
  }
  static int OpenFile(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* flags_out) {
    sqlite3_vfs& system = *Get().system;
    file->pMethods = nullptr;  // nothing for SQLite to close
    if (Disk().Open(name != nullptr ? name : "a temporary file") != Error::kNone) return SQLITE_CANTOPEN;
    constexpr int kJournals = SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_SUPER_JOURNAL | SQLITE_OPEN_WAL;
    const bool is_new = name != nullptr && access(name, F_OK) != 0;
    auto* ours = new (file) DiskFile(&kDiskMethods);
    if (const int code = system.xOpen(&system, name, ours->inner(), flags, flags_out); code != SQLITE_OK) {
      ours->~DiskFile();
      file->pMethods = nullptr;
      return code;
    }
    const bool is_kept = name != nullptr && (flags & SQLITE_OPEN_DELETEONCLOSE) == 0;
    if (is_kept) ours->Opened(Disk().Opened(name), is_new && (flags & kJournals) != 0);
    return SQLITE_OK;
  }
  static int DeleteFile(sqlite3_vfs*, const char* name, int sync_folder) {
    if (access(name, F_OK) != 0) return SQLITE_IOERR_DELETE_NOENT;
    if (const int code = ToCode(Disk().Remove(name), SQLITE_IOERR_DELETE); code != SQLITE_OK) return code;
    sqlite3_vfs& system = *Get().system;
    const int code = system.xDelete(&system, name, /*syncDir=*/0);
    if (code != SQLITE_OK || sync_folder == 0) return code;
    return ToCode(Disk().SyncNames(), SQLITE_IOERR_DIR_FSYNC);
  }

  sqlite3_vfs* system;
  sqlite3_vfs vfs;
};

int Fail(Error error) {
  errno = error == Error::kFull ? ENOSPC : EIO;
  return -1;
}

}  // namespace

FaultDisk& DiskUnderSqlite() {
  DiskVfs::Get();
  return Disk();
}

}  // namespace mapp

// In place of the C library's, for what the store does without SQLite: a copy that gets its name when it is on disk.
extern "C" int fsync(int descriptor) {
  struct stat facts {};
  if (fstat(descriptor, &facts) != 0) return -1;
  mapp::FaultDisk& disk = mapp::Disk();
  if (S_ISDIR(facts.st_mode)) {
    const auto error = disk.SyncNames();
    return error == mapp::Error::kNone ? 0 : mapp::Fail(error);
  }
  const auto file = disk.Find(facts.st_dev, facts.st_ino);
  if (file == nullptr) return 0;
  const auto error = disk.Sync(file);
  return error == mapp::Error::kNone ? 0 : mapp::Fail(error);
}

extern "C" int rename(const char* from, const char* to) noexcept {
  const auto error = mapp::Disk().Rename(from, to);
  return error == mapp::Error::kNone ? renameat(AT_FDCWD, from, AT_FDCWD, to) : mapp::Fail(error);
}

extern "C" int unlink(const char* name) noexcept {
  if (unlinkat(AT_FDCWD, name, 0) != 0) return -1;
  mapp::Disk().Removed(name);
  return 0;
}
