#include "storage/sqlite/file_lock.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

namespace mapp::sqlite {
namespace {

Status OpenError(const std::string& lock_file, int error) {
  const std::string message = fmt::format("cannot write {}: {}", lock_file, std::strerror(error));
  return error == ENOENT ? absl::NotFoundError(message) : absl::FailedPreconditionError(message);
}

/// Who holds the lock, as its owner wrote it; "another process" when it has not got to that yet.
std::string ReadOwner(int descriptor) {
  char text[32];
  const ssize_t length = pread(descriptor, text, sizeof(text), 0);
  return length > 0 ? "process " + std::string(text, static_cast<size_t>(length)) : "another process";
}

}  // namespace

StatusOr<std::unique_ptr<FileLock>> FileLock::Acquire(const std::string& file) {
  const std::string lock_file = file + ".lock";
  const int descriptor = open(lock_file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor < 0) return OpenError(lock_file, errno);
  std::unique_ptr<FileLock> lock(new FileLock(descriptor));
  if (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return OpenError(lock_file, errno);
    return absl::FailedPreconditionError(
        fmt::format("{} is in use by {}; only one server can own it: stop that first", file, ReadOwner(descriptor)));
  }
  // The number only serves the message above: failing to write it must not refuse the lock.
  const std::string owner = std::to_string(getpid());
  [[maybe_unused]] const bool noted =
      ftruncate(descriptor, 0) == 0 && pwrite(descriptor, owner.data(), owner.size(), 0) >= 0;
  return lock;
}

FileLock::~FileLock() { close(descriptor_); }

}  // namespace mapp::sqlite
