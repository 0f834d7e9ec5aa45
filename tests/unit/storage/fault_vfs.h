#pragma once

#include "tests/unit/storage/fault_disk.h"

namespace mapp {

/// The disk that SQLite uses in this process, underneath the checksums; and which hears of fsync(), rename() and
/// unlink(). It becomes SQLite's default VFS with the first call, which must come before any database is opened.
FaultDisk& DiskUnderSqlite();

}  // namespace mapp
