#include "bundle/bundle_writer.h"

#include "bundle/container.h"
#include "bundle/record_codec.h"

#include <fmt/format.h>

namespace mapp {
namespace {

constexpr size_t kFlushBytes = size_t{256} << 10;

}  // namespace

BundleWriter::BundleWriter(ByteSink sink) : sink_(std::move(sink)) {
  ByteWriter head;
  head.PutBytes(internal::kBundleMagic);
  head.Put<uint32_t>(internal::kBundleVersion);
  buffer_ = head.Take();
  crc_ = Crc32c(buffer_);
  num_bytes_ = buffer_.size();
}

Status BundleWriter::Add(const BundleRecord& record) {
  counts_.Add(record);
  return AddFramed(KindOf(record), EncodeRecord(record));
}

Status BundleWriter::Finish() {
  ByteWriter end;
  for (const uint64_t count : {counts_.cameras, counts_.sessions, counts_.points, counts_.frames, counts_.observers,
                               counts_.fused, counts_.tags, num_bytes_}) {
    end.Put<uint64_t>(count);
  }
  end.Put<uint32_t>(crc_);
  MAPP_RETURN_IF_ERROR(AddFramed(internal::kBundleEndKind, end.bytes()));
  return Flush();
}

Status BundleWriter::AddFramed(uint8_t kind, std::string_view payload) {
  if (payload.size() > internal::kMaxBundleRecordBytes) {
    return absl::ResourceExhaustedError(fmt::format("bundle: a {} of {} bytes, at most {}", KindName(kind),
                                                    payload.size(), internal::kMaxBundleRecordBytes));
  }
  ByteWriter framed;
  framed.Put<uint8_t>(kind);
  framed.Put<uint32_t>(static_cast<uint32_t>(payload.size()));
  framed.PutBytes(payload);
  framed.Put<uint32_t>(Crc32c(framed.bytes()));
  crc_ = ExtendCrc32c(crc_, framed.bytes());
  num_bytes_ += framed.size();
  buffer_ += framed.bytes();
  return buffer_.size() < kFlushBytes ? absl::OkStatus() : Flush();
}

Status BundleWriter::Flush() {
  const std::string bytes = std::move(buffer_);
  buffer_.clear();
  return sink_(bytes);
}

}  // namespace mapp
