#pragma once

#include "bundle/bundle_reader.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>

namespace mapp {

/// A bundle's bytes on disk. One thread only.
class BundleFile {
 public:
  /// NOT_FOUND, FAILED_PRECONDITION: cannot be opened; names the file.
  static StatusOr<BundleFile> Open(const std::string& file);
  /// Empty, to write and read, in `folder`, without a name there: a process that is killed leaves nothing.
  static StatusOr<BundleFile> CreateUnnamed(const std::string& folder);

  /// RESOURCE_EXHAUSTED: no room on the disk.
  Status Append(std::string_view bytes);
  /// Everything from the beginning, or RESOURCE_EXHAUSTED when what was appended has no room. One source at a time,
  /// which this file must outlive.
  StatusOr<ByteSource> Read();
  uint64_t num_bytes() const { return num_bytes_; }

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  BundleFile(std::FILE* file, uint64_t num_bytes) : file_(file), num_bytes_(num_bytes) {}

  std::unique_ptr<std::FILE, Closer> file_;
  uint64_t num_bytes_ = 0;
};

}  // namespace mapp
