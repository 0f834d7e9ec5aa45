#include "storage/sqlite/staged_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace mapp::sqlite {
namespace {

Status FileError(const std::string& file, int error) {
  const std::string message = fmt::format("{}: {}", file, std::strerror(error));
  switch (error) {
    case ENOENT:
      return absl::NotFoundError(message);
    case ENOSPC:
    case EDQUOT:
      return absl::ResourceExhaustedError(message);
    case EIO:
      return absl::UnavailableError(message);
    default:
      return absl::FailedPreconditionError(message);
  }
}

Status StatFile(const std::string& file, struct stat* facts) {
  return stat(file.c_str(), facts) == 0 ? absl::OkStatus() : FileError(file, errno);
}

bool IsSameFile(const struct stat& a, const struct stat& b) { return a.st_dev == b.st_dev && a.st_ino == b.st_ino; }

void RemoveCompanions(const std::string& file) {
  for (const char* suffix : {kWalSuffix, kJournalSuffix, kSharedMemorySuffix}) unlink((file + suffix).c_str());
}

}  // namespace

StatusOr<std::unique_ptr<StagedFile>> StagedFile::Create(const std::string& target) {
  const std::string path = target + ".unfinished";
  for (;;) {
    const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (descriptor < 0) return FileError(path, errno);
    if (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
      const int error = errno;
      close(descriptor);
      if (error != EWOULDBLOCK) return FileError(path, error);
      return absl::FailedPreconditionError(fmt::format("{}: another process is writing it", path));
    }
    struct stat claimed;
    struct stat present;
    const bool is_there = fstat(descriptor, &claimed) == 0 && lstat(path.c_str(), &present) == 0;
    // Between opening and locking, the owner before may have renamed or removed it.
    if (!is_there || !IsSameFile(claimed, present)) {
      close(descriptor);
      continue;
    }
    std::unique_ptr<StagedFile> staged(new StagedFile(target, path, descriptor));
    if (ftruncate(descriptor, 0) != 0 || fchmod(descriptor, 0600) != 0) return FileError(path, errno);
    RemoveCompanions(path);
    return staged;
  }
}

StagedFile::StagedFile(std::string target, std::string path, int descriptor)
    : target_(std::move(target)), path_(std::move(path)), descriptor_(descriptor) {}

StagedFile::~StagedFile() {
  if (!committed_) {
    unlink(path_.c_str());
    RemoveCompanions(path_);
  }
  close(descriptor_);
}

Status StagedFile::TakePermissions(const std::string& file) {
  struct stat facts;
  MAPP_RETURN_IF_ERROR(StatFile(file, &facts));
  return fchmod(descriptor_, facts.st_mode & 0777) == 0 ? absl::OkStatus() : FileError(path_, errno);
}

Status StagedFile::TakeOwner(const std::string& file) {
  struct stat facts;
  MAPP_RETURN_IF_ERROR(StatFile(file, &facts));
  // Only root may give a file away; anybody else keeps it.
  if (fchown(descriptor_, facts.st_uid, facts.st_gid) == 0 || errno == EPERM) return absl::OkStatus();
  return FileError(path_, errno);
}

Status StagedFile::Sync() { return fsync(descriptor_) == 0 ? absl::OkStatus() : FileError(path_, errno); }

Status StagedFile::Commit(Existing existing) {
  MAPP_RETURN_IF_ERROR(Sync());
  std::error_code error;
  if (existing == Existing::kRefuse && std::filesystem::exists(std::filesystem::symlink_status(target_, error))) {
    return absl::AlreadyExistsError(fmt::format("{} is there already", target_));
  }
  if (rename(path_.c_str(), target_.c_str()) != 0) return FileError(target_, errno);
  committed_ = true;
  const Status synced = SyncFolder(std::filesystem::path(target_).parent_path().string());
  // What fails leaves nothing; only what has been replaced cannot be brought back.
  if (!synced.ok() && existing == Existing::kRefuse) unlink(target_.c_str());
  return synced;
}

Status SyncFolder(const std::string& folder) {
  const std::string& name = folder.empty() ? std::string(".") : folder;
  const int descriptor = open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return FileError(name, errno);
  const bool synced = fsync(descriptor) == 0;
  const int error = errno;
  close(descriptor);
  return synced ? absl::OkStatus() : FileError(name, error);
}

}  // namespace mapp::sqlite
