#include "storage/sqlite/checksum_vfs.h"

#include "mapp/base/bytes.h"
#include "mapp/base/check.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/errors.h"

#include <sqlite3.h>

#include <algorithm>
#include <bit>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <utility>

namespace mapp::sqlite {
namespace {

constexpr char kVfsName[] = "mapp-checksum";

// The database header, https://www.sqlite.org/fileformat2.html, section 1.3.
constexpr std::string_view kHeaderMagic("SQLite format 3\0", 16);
constexpr int kFileHeaderBytes = 100;
constexpr size_t kPageSizeOffset = 16;
constexpr size_t kReservedBytesOffset = 20;
constexpr uint32_t kLeastPageBytes = 512;
constexpr uint32_t kGreatestPageBytes = 65536;

/// Not UTF-8, and so not the end of a first page without checksums, which is the text of the schema or zero.
constexpr uint32_t kTrailerTag = 0xfec5fec5U;

// File controls of our own, which SQLite hands through; its own are below 100.
constexpr int kFileControlFollow = 0x4d61'7001;       // no argument: FollowChecksums
constexpr int kFileControlDamagedPage = 0x4d61'7002;  // uint32_t*: LastDamagedPage, or 0
constexpr int kFileControlReadError = 0x4d61'7003;    // int*: TakeReadError

/// What the last kPageTrailerBytes of a page are.
struct Trailer {
  uint32_t crc = 0;  ///< CRC-32C of the page before the trailer
  uint32_t tag = 0;  ///< kTrailerTag ^ the page's number: a page in another's place is damage, too

  static Trailer Of(std::string_view page, uint32_t number) {
    return {Crc32c(page.substr(0, page.size() - kPageTrailerBytes)), kTrailerTag ^ number};
  }
  static Trailer Read(std::string_view page) {
    ByteReader reader(page.substr(page.size() - kPageTrailerBytes));
    Trailer trailer;
    trailer.crc = reader.Get<uint32_t>();
    trailer.tag = reader.Get<uint32_t>();
    return trailer;
  }
  std::string Bytes() const {
    ByteWriter writer;
    writer.Put<uint32_t>(crc);
    writer.Put<uint32_t>(tag);
    return std::string(writer.bytes());
  }
  bool operator==(const Trailer&) const = default;
};

/// The main file of a database. SQLite allocates it, with the system's own file behind it.
class ChecksumFile {
 public:
  explicit ChecksumFile(const sqlite3_io_methods* methods) { base_.pMethods = methods; }

  static ChecksumFile& From(sqlite3_file* file) { return *reinterpret_cast<ChecksumFile*>(file); }
  sqlite3_file* inner() { return reinterpret_cast<sqlite3_file*>(this + 1); }

  int Read(void* buffer, int num_bytes, sqlite3_int64 offset) {
    const int code = ReadChecked(buffer, num_bytes, offset);
    // SQLite looks for what may be behind the end of the file, too.
    if (code != SQLITE_OK && code != SQLITE_IOERR_SHORT_READ) read_error_ = code;
    return code;
  }

  int Write(const void* buffer, int num_bytes, sqlite3_int64 offset) {
    const std::string_view page(static_cast<const char*>(buffer), static_cast<size_t>(num_bytes));
    Learn(page, offset);
    // Whole pages are all that SQLite writes, of a size that may not be known before the first.
    if (!has_checksums_ || !std::has_single_bit(page.size()) || page.size() < kLeastPageBytes) {
      return inner()->pMethods->xWrite(inner(), buffer, num_bytes, offset);
    }
    // The buffer is SQLite's cache or a frame of its log: not ours to change.
    if (scratch_ == nullptr) scratch_.reset(new (std::nothrow) char[kGreatestPageBytes]);
    if (scratch_ == nullptr) return SQLITE_IOERR_NOMEM;
    const std::string trailer = Trailer::Of(page, PageNumber(offset, num_bytes)).Bytes();
    const size_t num_content_bytes = page.size() - trailer.size();
    page.copy(scratch_.get(), num_content_bytes);
    trailer.copy(scratch_.get() + num_content_bytes, trailer.size());
    return inner()->pMethods->xWrite(inner(), scratch_.get(), num_bytes, offset);
  }

  int Control(int operation, void* argument) {
    switch (operation) {
      case kFileControlFollow:
        has_checksums_ = true;
        return SQLITE_OK;
      case kFileControlDamagedPage:
        *static_cast<uint32_t*>(argument) = damaged_page_;
        return SQLITE_OK;
      case kFileControlReadError:
        *static_cast<int*>(argument) = std::exchange(read_error_, SQLITE_OK);
        return SQLITE_OK;
      case SQLITE_FCNTL_CKPT_START:
        // Another connection may have given the file its checksums since this one last looked.
        if (const int code = LearnFromFile(); code != SQLITE_OK) return code;
        break;
      case SQLITE_FCNTL_PRAGMA:
        // VACUUM would write the new pages in pieces of the old size. It keeps the size without a word in other cases,
        // too.
        if (has_checksums_ && SetsPageSize(static_cast<char**>(argument))) return SQLITE_OK;
        break;
      default:
        break;
    }
    return inner()->pMethods->xFileControl(inner(), operation, argument);
  }

 private:
  /// `pragma`: room for an answer, name, value or null.
  static bool SetsPageSize(char** pragma) {
    return sqlite3_stricmp(pragma[1], "page_size") == 0 && pragma[2] != nullptr;
  }
  static uint32_t PageNumber(sqlite3_int64 offset, int page_bytes) {
    return static_cast<uint32_t>(offset / page_bytes + 1);
  }

  /// The first page says what all are like; it comes before the others in a checkpoint and is read before them.
  void Learn(std::string_view bytes, sqlite3_int64 offset) {
    if (offset != 0 || bytes.size() < kFileHeaderBytes || !bytes.starts_with(kHeaderMagic)) return;
    const auto byte = [&](size_t i) { return static_cast<uint32_t>(static_cast<unsigned char>(bytes[i])); };
    // Neither the page size nor the checksums of a database with checksums change: to say so would be damage.
    if (!has_checksums_) {
      const uint32_t told = byte(kPageSizeOffset) << 8 | byte(kPageSizeOffset + 1);
      page_bytes_ = told == 1 ? kGreatestPageBytes : told;
      if (page_bytes_ < kLeastPageBytes || !std::has_single_bit(page_bytes_)) page_bytes_ = 0;
    }
    if (byte(kReservedBytesOffset) == kPageTrailerBytes) has_checksums_ = true;
    if (bytes.size() == page_bytes_ && Trailer::Read(bytes).tag == (kTrailerTag ^ 1)) has_checksums_ = true;
  }

  int ReadChecked(void* buffer, int num_bytes, sqlite3_int64 offset) {
    const int code = inner()->pMethods->xRead(inner(), buffer, num_bytes, offset);
    if (code != SQLITE_OK) return code;
    const std::string_view bytes(static_cast<const char*>(buffer), static_cast<size_t>(num_bytes));
    Learn(bytes, offset);
    // SQLite also reads parts of the first page: the header before it knows the page size, the change counter.
    const bool is_page = page_bytes_ > 0 ? bytes.size() == page_bytes_ : bytes.size() >= kLeastPageBytes;
    if (!has_checksums_ || !is_page) return SQLITE_OK;
    return CheckPage(bytes, PageNumber(offset, num_bytes)) ? SQLITE_OK : SQLITE_IOERR_DATA;
  }

  int LearnFromFile() {
    char header[kFileHeaderBytes];
    const int code = inner()->pMethods->xRead(inner(), header, kFileHeaderBytes, 0);
    if (code == SQLITE_IOERR_SHORT_READ) return SQLITE_OK;
    if (code == SQLITE_OK) Learn({header, kFileHeaderBytes}, 0);
    return code;
  }

  bool CheckPage(std::string_view page, uint32_t number) {
    if (Trailer::Read(page) == Trailer::Of(page, number)) return true;
    // Allocated and freed again before it was ever written: a hole in the file.
    if (std::ranges::all_of(page, [](char byte) { return byte == 0; })) return true;
    damaged_page_ = number;
    return false;
  }

  sqlite3_file base_{};      ///< first: what SQLite sees
  uint32_t page_bytes_ = 0;  ///< 0: not known, or told wrong
  bool has_checksums_ = false;
  uint32_t damaged_page_ = 0;
  int read_error_ = SQLITE_OK;
  std::unique_ptr<char[]> scratch_;  ///< a page to be written
};
static_assert(sizeof(ChecksumFile) % 8 == 0, "the system's file behind it must be aligned");

sqlite3_file* Inner(sqlite3_file* file) { return ChecksumFile::From(file).inner(); }
const sqlite3_io_methods& InnerMethods(sqlite3_file* file) { return *Inner(file)->pMethods; }

int CloseFile(sqlite3_file* file) {
  ChecksumFile& ours = ChecksumFile::From(file);
  const int code = InnerMethods(file).xClose(Inner(file));
  ours.~ChecksumFile();
  return code;
}

/// Version 2: without xFetch, through which SQLite would read pages past the check.
constexpr sqlite3_io_methods kMethods = {
    .iVersion = 2,
    .xClose = CloseFile,
    .xRead = [](sqlite3_file* file, void* buffer, int num_bytes,
                sqlite3_int64 offset) { return ChecksumFile::From(file).Read(buffer, num_bytes, offset); },
    .xWrite = [](sqlite3_file* file, const void* buffer, int num_bytes,
                 sqlite3_int64 offset) { return ChecksumFile::From(file).Write(buffer, num_bytes, offset); },
    .xTruncate = [](sqlite3_file* file, sqlite3_int64 size) { return InnerMethods(file).xTruncate(Inner(file), size); },
    .xSync = [](sqlite3_file* file, int flags) { return InnerMethods(file).xSync(Inner(file), flags); },
    .xFileSize = [](sqlite3_file* file,
                    sqlite3_int64* size) { return InnerMethods(file).xFileSize(Inner(file), size); },
    .xLock = [](sqlite3_file* file, int lock) { return InnerMethods(file).xLock(Inner(file), lock); },
    .xUnlock = [](sqlite3_file* file, int lock) { return InnerMethods(file).xUnlock(Inner(file), lock); },
    .xCheckReservedLock = [](sqlite3_file* file,
                             int* result) { return InnerMethods(file).xCheckReservedLock(Inner(file), result); },
    .xFileControl = [](sqlite3_file* file, int operation,
                       void* argument) { return ChecksumFile::From(file).Control(operation, argument); },
    .xSectorSize = [](sqlite3_file* file) { return InnerMethods(file).xSectorSize(Inner(file)); },
    .xDeviceCharacteristics = [](sqlite3_file* file) { return InnerMethods(file).xDeviceCharacteristics(Inner(file)); },
    .xShmMap =
        [](sqlite3_file* file, int region, int num_bytes, int extend, void volatile** memory) {
          return InnerMethods(file).xShmMap(Inner(file), region, num_bytes, extend, memory);
        },
    .xShmLock = [](sqlite3_file* file, int offset, int count,
                   int flags) { return InnerMethods(file).xShmLock(Inner(file), offset, count, flags); },
    .xShmBarrier = [](sqlite3_file* file) { InnerMethods(file).xShmBarrier(Inner(file)); },
    .xShmUnmap = [](sqlite3_file* file, int remove) { return InnerMethods(file).xShmUnmap(Inner(file), remove); },
    .xFetch = nullptr,
    .xUnfetch = nullptr,
};

sqlite3_vfs& SystemVfs(sqlite3_vfs* ours);

int OpenFile(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* flags_out) {
  sqlite3_vfs& system = SystemVfs(vfs);
  // Journals, logs and temporary files hold no pages that stay, or checksums of SQLite's own.
  if ((flags & SQLITE_OPEN_MAIN_DB) == 0) return system.xOpen(&system, name, file, flags, flags_out);
  auto* ours = new (file) ChecksumFile(&kMethods);
  const int code = system.xOpen(&system, name, ours->inner(), flags, flags_out);
  if (code == SQLITE_OK) return SQLITE_OK;
  ours->~ChecksumFile();
  file->pMethods = nullptr;  // nothing for SQLite to close
  return code;
}

struct ChecksumVfs {
  ChecksumVfs() : system(sqlite3_vfs_find(nullptr)) {
    MAPP_CHECK(system != nullptr);
    vfs = *system;  // all but opening a file is the system's
    vfs.pNext = nullptr;
    vfs.zName = kVfsName;
    vfs.szOsFile = static_cast<int>(sizeof(ChecksumFile)) + system->szOsFile;
    vfs.xOpen = OpenFile;
    MAPP_CHECK(sqlite3_vfs_register(&vfs, /*makeDflt=*/0) == SQLITE_OK);
  }

  sqlite3_vfs vfs;  ///< first
  sqlite3_vfs* system;
};

sqlite3_vfs& SystemVfs(sqlite3_vfs* ours) { return *reinterpret_cast<ChecksumVfs*>(ours)->system; }

/// What the database reserves, or shall when it is next written anew if that is more; `wanted` is what it shall.
int ExchangeReservedBytes(Connection& db, int wanted) {
  sqlite3_file_control(db.handle(), "main", SQLITE_FCNTL_RESERVE_BYTES, &wanted);
  return wanted;
}

}  // namespace

const char* ChecksumVfsName() {
  static const ChecksumVfs& vfs = *new ChecksumVfs();  // SQLite keeps a pointer to it for as long as the process runs
  return vfs.vfs.zName;
}

void ReserveTrailer(Connection& db) { ExchangeReservedBytes(db, kPageTrailerBytes); }

bool HasChecksums(Connection& db) {
  ExchangeReservedBytes(db, 0);  // a database keeps what it reserves already
  constexpr int kOnlyAsk = -1;
  return ExchangeReservedBytes(db, kOnlyAsk) == kPageTrailerBytes;
}

Status FollowChecksums(Connection& source, Connection& copy) {
  if (!HasChecksums(source)) return absl::OkStatus();
  return SqliteError(sqlite3_file_control(copy.handle(), "main", kFileControlFollow, nullptr), "copy", copy.handle());
}

Status EnableChecksums(Connection& db) {
  // Read, so that the connection knows the database as it is.
  MAPP_RETURN_IF_ERROR(db.QueryInt64("SELECT count(*) FROM sqlite_schema").status());
  if (HasChecksums(db)) return absl::OkStatus();
  // Through the log, whose pages reach the file in order, the first first: a rollback journal would have to bring back
  // pages without a checksum among some with.
  {
    Statement journal = db.Prepare("PRAGMA journal_mode = WAL");
    MAPP_RETURN_IF_ERROR(journal.Step().status());
    if (journal.Bytes(0) != "wal") return absl::FailedPreconditionError("map database: cannot use a write-ahead log");
  }
  ReserveTrailer(db);
  MAPP_RETURN_IF_ERROR(db.Execute("VACUUM;"));
  return db.QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)").status();
}

std::optional<uint32_t> LastDamagedPage(sqlite3* db) {
  uint32_t page = 0;
  const int code = sqlite3_file_control(db, "main", kFileControlDamagedPage, &page);
  if (code != SQLITE_OK || page == 0) return std::nullopt;
  return page;
}

int TakeReadError(sqlite3* db) {
  int code = SQLITE_OK;
  sqlite3_file_control(db, "main", kFileControlReadError, &code);
  return code;
}

}  // namespace mapp::sqlite
