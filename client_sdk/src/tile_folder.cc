#include "tile_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace mapp {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTileSuffix = ".tile";
constexpr std::string_view kPartSuffix = ".part";
constexpr std::string_view kMapPrefix = "map-";
/// Room that is made at once, so that not every tile makes some.
constexpr double kFillAfterRemoval = 0.9;
/// A file half written for longer has lost its writer.
constexpr std::chrono::hours kPartLifetime{1};

Status Unusable(const fs::path& folder, const std::string& why) {
  return absl::FailedPreconditionError(fmt::format("tile_cache.folder: {}: {}", folder.string(), why));
}

/// No other writer, here or in another process, uses the name.
fs::path PartBeside(const fs::path& file) {
  static std::atomic<uint64_t> next{0};
  fs::path part = file;
  part += fmt::format(".{}-{}{}", getpid(), next++, kPartSuffix);
  return part;
}

/// Whole under its name, or not at all. It need not outlast a power cut: a torn tile is found by its checksum.
Status WriteWhole(const fs::path& file, std::string_view bytes) {
  const fs::path part = PartBeside(file);
  bool written = false;
  {
    std::ofstream out(part, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.close();
    written = out.good();
  }
  std::error_code error;
  if (written) fs::rename(part, file, error);
  if (written && !error) return absl::OkStatus();
  std::error_code ignored;
  fs::remove(part, ignored);
  return absl::ResourceExhaustedError(fmt::format("{}: {}", file.string(), error ? error.message() : "cannot write"));
}

std::optional<TileKey> KeyOfFile(const fs::path& file) {
  const std::string name = file.filename().string();
  constexpr size_t kDigits = 16;
  if (name.size() != kDigits + kTileSuffix.size() || !name.ends_with(kTileSuffix)) return std::nullopt;
  uint64_t packed = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + kDigits, packed, 16);
  if (error != std::errc() || end != name.data() + kDigits) return std::nullopt;
  const TileKey key = TileKey::FromPacked(packed);
  return key.Packed() == packed ? std::optional(key) : std::nullopt;
}

struct StoredFile {
  fs::path path;
  fs::file_time_type used;
  uint64_t bytes = 0;
};

/// Files in `folder` that `wanted` names; what vanishes meanwhile is left out.
template <typename Wanted>
std::vector<StoredFile> FilesIn(const fs::path& folder, const Wanted& wanted) {
  std::vector<StoredFile> files;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code gone;
    if (!wanted(it->path()) || !it->is_regular_file(gone) || gone) continue;
    StoredFile file{it->path(), it->last_write_time(gone), 0};
    if (!gone) file.bytes = it->file_size(gone);
    if (!gone) files.push_back(std::move(file));
  }
  return files;
}

std::vector<fs::path> MapFolders(const fs::path& root) {
  std::vector<fs::path> folders;
  std::error_code error;
  for (fs::directory_iterator it(root, error), end; !error && it != end; it.increment(error)) {
    std::error_code gone;
    if (it->path().filename().string().starts_with(kMapPrefix) && it->is_directory(gone) && !gone) {
      folders.push_back(it->path());
    }
  }
  return folders;
}

bool IsTile(const fs::path& file) { return KeyOfFile(file).has_value(); }
bool IsPart(const fs::path& file) { return file.filename().string().ends_with(kPartSuffix); }

}  // namespace

Status TileFolder::CheckUsable(const TileCacheOptions& options) {
  const fs::path root = options.folder;
  std::error_code error;
  fs::create_directories(root, error);
  if (error) return Unusable(root, error.message());
  if (!fs::is_directory(root, error)) return Unusable(root, "is no folder");
  const fs::path trial = PartBeside(root / "trial");
  const Status written = WriteWhole(trial, "trial");
  fs::remove(trial, error);
  return written.ok() ? absl::OkStatus() : Unusable(root, "cannot be written");
}

TileFolder::TileFolder(const TileCacheOptions& options, const MapIdentity& map)
    : root_(options.folder),
      folder_(root_ / fmt::format("{}{}-{:x}", kMapPrefix, map.id.value(), map.created_ns)),
      max_bytes_(options.max_bytes) {}

StatusOr<std::unique_ptr<TileFolder>> TileFolder::Open(const TileCacheOptions& options, const MapIdentity& map) {
  MAPP_RETURN_IF_ERROR(CheckUsable(options));
  std::unique_ptr<TileFolder> opened(new TileFolder(options, map));
  const auto oldest = fs::file_time_type::clock::now() - kPartLifetime;
  for (const StoredFile& part : FilesIn(opened->folder_, IsPart)) {
    std::error_code ignored;
    if (part.used < oldest) fs::remove(part.path, ignored);
  }
  opened->RemoveLeastUsed();
  return opened;
}

fs::path TileFolder::FileOf(const TileKey& key) const {
  return folder_ / fmt::format("{:016x}{}", key.Packed(), kTileSuffix);
}

std::vector<TileKey> TileFolder::Keys() const {
  std::vector<TileKey> keys;
  for (const StoredFile& file : FilesIn(folder_, IsTile)) keys.push_back(*KeyOfFile(file.path));
  return keys;
}

std::optional<std::string> TileFolder::Read(const TileKey& key) const {
  const fs::path file = FileOf(key);
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  std::string bytes(std::istreambuf_iterator<char>(in), {});
  if (in.bad()) return std::nullopt;
  std::error_code ignored;  // only the order of removal hangs on it
  fs::last_write_time(file, fs::file_time_type::clock::now(), ignored);
  return bytes;
}

Status TileFolder::Write(const TileKey& key, std::string_view bytes) {
  std::error_code error;
  fs::create_directories(folder_, error);  // another device may have emptied and removed it
  if (error) return Unusable(folder_, error.message());
  MAPP_RETURN_IF_ERROR(WriteWhole(FileOf(key), bytes));
  bytes_since_look_ += bytes.size();
  if (bytes_at_look_ + bytes_since_look_ > max_bytes_) RemoveLeastUsed();
  return absl::OkStatus();
}

void TileFolder::Remove(const TileKey& key) {
  std::error_code ignored;  // gone is gone
  fs::remove(FileOf(key), ignored);
}

void TileFolder::RemoveLeastUsed() {
  std::vector<StoredFile> files;
  const std::vector<fs::path> folders = MapFolders(root_);
  for (const fs::path& folder : folders) {
    std::ranges::move(FilesIn(folder, IsTile), std::back_inserter(files));
  }
  bytes_since_look_ = 0;
  bytes_at_look_ = 0;
  for (const StoredFile& file : files) bytes_at_look_ += file.bytes;
  if (bytes_at_look_ <= max_bytes_) return;
  std::ranges::sort(files, {}, &StoredFile::used);
  const auto bytes_to_keep = static_cast<uint64_t>(kFillAfterRemoval * static_cast<double>(max_bytes_));
  std::error_code ignored;
  for (const StoredFile& file : files) {
    if (bytes_at_look_ <= bytes_to_keep) break;
    fs::remove(file.path, ignored);
    bytes_at_look_ -= file.bytes;
  }
  for (const fs::path& folder : folders) fs::remove(folder, ignored);  // fails where something is in it
}

}  // namespace mapp
