#include "bundle/bundle_reader.h"

#include "bundle/container.h"
#include "bundle/record_codec.h"

#include <fmt/format.h>

namespace mapp {
namespace {

Status Damaged(uint64_t position, const std::string& what) {
  return absl::DataLossError(
      fmt::format("the bundle is damaged at byte {} ({}): copy it anew, or export the map again", position, what));
}

}  // namespace

StatusOr<BundleReader> BundleReader::Open(ByteSource source) {
  BundleReader reader(std::move(source));
  const Status read = reader.Read(internal::kBundleHeadBytes);
  const std::string_view head = reader.record_;
  const std::string_view magic = head.substr(0, internal::kBundleMagic.size());
  if (!read.ok()) {
    if (!absl::IsDataLoss(read)) return read;
    const bool begins_as_one = !magic.empty() && internal::kBundleMagic.starts_with(magic);
    return begins_as_one ? read : absl::InvalidArgumentError("not a map bundle (mapp maps export writes them)");
  }
  if (magic != internal::kBundleMagic) {
    return absl::InvalidArgumentError("not a map bundle (mapp maps export writes them)");
  }
  const auto version = ByteReader(head.substr(magic.size())).Get<uint32_t>();
  if (version != internal::kBundleVersion) {
    return absl::FailedPreconditionError(fmt::format(
        "the bundle is of format {}, and this program reads format {}: {}", version, internal::kBundleVersion,
        version > internal::kBundleVersion ? "use a newer one" : "export the map again"));
  }
  return reader;
}

StatusOr<std::optional<BundleRecord>> BundleReader::Next() {
  record_.clear();
  const uint64_t begin = num_bytes_;
  const uint32_t crc_before = crc_;
  MAPP_RETURN_IF_ERROR(Read(internal::kBundleFrameBytes));
  ByteReader frame(record_);
  const auto kind = frame.Get<uint8_t>();
  const auto length = frame.Get<uint32_t>();
  // Before anything of that size is allocated.
  if (length > internal::kMaxBundleRecordBytes) return Damaged(begin, fmt::format("a record of {} bytes", length));
  MAPP_RETURN_IF_ERROR(Read(length + sizeof(uint32_t)));
  const std::string_view covered = std::string_view(record_).substr(0, internal::kBundleFrameBytes + length);
  const auto stored = ByteReader(std::string_view(record_).substr(covered.size())).Get<uint32_t>();
  if (const uint32_t crc = Crc32c(covered); crc != stored) {
    return Damaged(begin, fmt::format("crc32c {:#010x} != stored {:#010x}", crc, stored));
  }
  const std::string_view payload = covered.substr(internal::kBundleFrameBytes);
  if (kind == internal::kBundleEndKind) {
    MAPP_RETURN_IF_ERROR(CheckEnd(payload, begin, crc_before));
    return std::optional<BundleRecord>();
  }
  StatusOr<BundleRecord> record = DecodeRecord(kind, payload);
  if (!record.ok()) {
    return Damaged(begin, fmt::format("{}: {}", KindName(kind), std::string(record.status().message())));
  }
  counts_.Add(*record);
  return std::optional<BundleRecord>(*std::move(record));
}

Status BundleReader::Read(size_t size) {
  const size_t before = record_.size();
  record_.resize(before + size);
  MAPP_ASSIGN_OR_RETURN(const size_t num_read, source_(record_.data() + before, size));
  record_.resize(before + num_read);
  crc_ = ExtendCrc32c(crc_, std::string_view(record_).substr(before));
  num_bytes_ += num_read;
  if (num_read == size) return absl::OkStatus();
  return absl::DataLossError(fmt::format(
      "the bundle is cut short, it ends after {} bytes: copy it anew, or export the map again", num_bytes_));
}

Status BundleReader::CheckEnd(std::string_view payload, uint64_t bytes_before, uint32_t crc_before) {
  ByteReader end(payload);
  BundleCounts counts;
  for (uint64_t* const count : {&counts.cameras, &counts.sessions, &counts.points, &counts.frames, &counts.observers,
                                &counts.fused, &counts.tags}) {
    *count = end.Get<uint64_t>();
  }
  const auto num_bytes = end.Get<uint64_t>();
  const auto crc = end.Get<uint32_t>();
  if (end.failed() || end.remaining() != 0) return Damaged(bytes_before, "its end is of another length");
  if (counts != counts_) return Damaged(bytes_before, "it has not as many records as its end says");
  if (num_bytes != bytes_before) return Damaged(bytes_before, fmt::format("its end says {} bytes", num_bytes));
  if (crc != crc_before) {
    return Damaged(bytes_before, fmt::format("crc32c of all {:#010x} != stored {:#010x}", crc_before, crc));
  }
  char more = 0;
  MAPP_ASSIGN_OR_RETURN(const size_t num_more, source_(&more, 1));
  return num_more == 0 ? absl::OkStatus() : Damaged(num_bytes_, "something follows its end");
}

}  // namespace mapp
