#pragma once

#include "bundle/records.h"
#include "mapp/base/status.h"

#include <functional>
#include <optional>
#include <string>
#include <utility>

namespace mapp {

/// Reads the next bytes to `to`, fewer than `size` only where they end; returns how many.
using ByteSource = std::function<StatusOr<size_t>(char* to, size_t size)>;

/// Reads a bundle (docs/formats/bundle.md) record by record; needs the memory of one. After an error it is of no use.
class BundleReader {
 public:
  /// INVALID_ARGUMENT: not a bundle. FAILED_PRECONDITION: of a format that this program does not know, by number.
  static StatusOr<BundleReader> Open(ByteSource source);

  /// nullopt after the last one, once the end has been read and agrees with all before it.
  /// DATA_LOSS: cut short, damaged, or something follows the end; says where.
  StatusOr<std::optional<BundleRecord>> Next();
  /// Of what was read so far.
  const BundleCounts& counts() const { return counts_; }
  uint64_t num_bytes() const { return num_bytes_; }

 private:
  explicit BundleReader(ByteSource source) : source_(std::move(source)) {}
  /// The next `size` bytes, at the end of record_. DATA_LOSS when there are fewer.
  Status Read(size_t size);
  Status CheckEnd(std::string_view payload, uint64_t bytes_before, uint32_t crc_before);

  ByteSource source_;
  std::string record_;  ///< with its frame
  BundleCounts counts_;
  uint64_t num_bytes_ = 0;
  uint32_t crc_ = 0;
};

}  // namespace mapp
