#include "bundle/bundle_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sys/stat.h>
#include <unistd.h>

namespace mapp {
namespace {

Status ErrorOf(const std::string& file, int error) {
  const std::string message = fmt::format("{}: {}", file, std::strerror(error));
  if (error == ENOENT) return absl::NotFoundError(message);
  if (error == ENOSPC || error == EDQUOT) return absl::ResourceExhaustedError(message);
  return absl::FailedPreconditionError(message);
}

}  // namespace

StatusOr<BundleFile> BundleFile::Open(const std::string& file) {
  std::FILE* const stream = std::fopen(file.c_str(), "rbe");
  if (stream == nullptr) return ErrorOf(file, errno);
  BundleFile opened(stream, 0);
  struct stat facts;
  if (fstat(fileno(stream), &facts) != 0) return ErrorOf(file, errno);
  if (!S_ISREG(facts.st_mode)) return absl::FailedPreconditionError(fmt::format("{}: is no file", file));
  opened.num_bytes_ = static_cast<uint64_t>(facts.st_size);
  return opened;
}

StatusOr<BundleFile> BundleFile::CreateUnnamed(const std::string& folder) {
  std::string name = folder + "/mapp-bundle-XXXXXX";
  const int descriptor = mkstemp(name.data());
  if (descriptor < 0) return ErrorOf(folder, errno);
  unlink(name.c_str());
  std::FILE* const stream = fdopen(descriptor, "w+b");
  if (stream != nullptr) return BundleFile(stream, 0);
  const int error = errno;
  close(descriptor);
  return ErrorOf(folder, error);
}

Status BundleFile::Append(std::string_view bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size()) return ErrorOf("the bundle", errno);
  num_bytes_ += bytes.size();
  return absl::OkStatus();
}

StatusOr<ByteSource> BundleFile::Read() {
  if (std::fflush(file_.get()) != 0 || std::fseek(file_.get(), 0, SEEK_SET) != 0) return ErrorOf("the bundle", errno);
  return ByteSource([file = file_.get()](char* to, size_t size) -> StatusOr<size_t> {
    const size_t num_read = std::fread(to, 1, size, file);
    if (num_read < size && std::ferror(file) != 0) return absl::UnavailableError("the bundle cannot be read");
    return num_read;
  });
}

}  // namespace mapp
