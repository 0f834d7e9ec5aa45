#pragma once

#include "bundle/records.h"
#include "mapp/base/status.h"

#include <functional>
#include <string>
#include <string_view>

namespace mapp {

/// Takes a bundle's bytes in order.
using ByteSink = std::function<Status(std::string_view)>;

/// Writes a bundle (docs/formats/bundle.md), some 256 KB to the sink at a time.
class BundleWriter {
 public:
  explicit BundleWriter(ByteSink sink);

  /// Records in the order of BundleRecord, BundleMap first and once. Errors are the sink's; RESOURCE_EXHAUSTED: a
  /// record greater than a bundle may have.
  Status Add(const BundleRecord& record);
  /// Without it the bundle counts as cut short.
  Status Finish();

 private:
  Status AddFramed(uint8_t kind, std::string_view payload);
  Status Flush();

  const ByteSink sink_;
  BundleCounts counts_;
  std::string buffer_;
  uint64_t num_bytes_ = 0;  ///< so far, the buffer included
  uint32_t crc_ = 0;        ///< of them
};

}  // namespace mapp
