#include "vision/place_block.h"

#include "mapp/base/bytes.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp {
namespace {

constexpr uint32_t kMagic = 0x4b42504d;  // "MPBK"
constexpr uint8_t kVersion = 1;
constexpr size_t kChecksumBytes = 4;

Status Broken(std::string_view what) { return absl::DataLossError(fmt::format("place block: {}", what)); }

/// Ascending, with every position that of a frame.
Status CheckTable(const std::vector<uint32_t>& entries, size_t num_frames) {
  const auto is_beyond = [num_frames](uint32_t entry) { return (entry & (PlaceBlock::kMaxFrames - 1)) >= num_frames; };
  if (std::ranges::any_of(entries, is_beyond)) return Broken("an entry of a frame that is not there");
  return absl::OkStatus();
}

}  // namespace

std::string EncodePlaceBlock(const PlaceBlock& block) {
  ByteWriter writer;
  writer.Put(kMagic);
  writer.Put(kVersion);
  writer.Put(static_cast<uint8_t>(block.words.num_tables));
  writer.Put(static_cast<uint8_t>(block.words.bits_per_key));
  writer.Put(block.words.seed);
  writer.PutVarint(block.frames.size());
  for (const PlaceBlock::Frame& frame : block.frames) {
    writer.PutVarint(frame.id);
    writer.PutVarint(frame.num_features);
  }
  for (const std::vector<uint32_t>& entries : block.tables) {
    writer.PutVarint(entries.size());
    uint32_t previous = 0;
    for (const uint32_t entry : entries) {
      writer.PutVarint(entry - previous);
      previous = entry;
    }
  }
  writer.Put(Crc32c(writer.bytes()));
  return writer.Take();
}

StatusOr<PlaceBlock> DecodePlaceBlock(std::string_view bytes) {
  if (bytes.size() < kChecksumBytes) return Broken("cut short");
  ByteReader checksum(bytes.substr(bytes.size() - kChecksumBytes));
  bytes.remove_suffix(kChecksumBytes);
  if (checksum.Get<uint32_t>() != Crc32c(bytes)) return Broken("wrong checksum");
  ByteReader reader(bytes);
  if (reader.Get<uint32_t>() != kMagic) return Broken("no such block");
  if (const uint8_t version = reader.Get<uint8_t>(); version != kVersion) {
    return Broken(fmt::format("version {}, this program reads {}", version, kVersion));
  }
  PlaceBlock block;
  block.words.num_tables = reader.Get<uint8_t>();
  block.words.bits_per_key = reader.Get<uint8_t>();
  block.words.seed = reader.Get<uint64_t>();
  if (block.words.num_tables < 1 || block.words.bits_per_key < PlaceWords::kMinBits ||
      block.words.bits_per_key > PlaceWords::kMaxBits) {
    return Broken("words that cannot be");
  }
  const uint64_t num_frames = reader.GetVarint();
  if (num_frames > PlaceBlock::kMaxFrames) return Broken("too many frames");
  for (uint64_t i = 0; i < num_frames; ++i) {
    const uint64_t id = reader.GetVarint();
    block.frames.push_back({id, static_cast<uint32_t>(reader.GetVarint())});
  }
  for (int t = 0; t < block.words.num_tables; ++t) {
    const uint64_t num_entries = reader.GetVarint();
    if (num_entries > reader.remaining()) return Broken("cut short");
    std::vector<uint32_t> entries;
    entries.reserve(num_entries);
    uint64_t entry = 0;
    for (uint64_t i = 0; i < num_entries; ++i) {
      const uint64_t step = reader.GetVarint();
      entry += step;
      if ((i > 0 && step == 0) || entry > UINT32_MAX) return Broken("entries out of order");
      entries.push_back(static_cast<uint32_t>(entry));
    }
    MAPP_RETURN_IF_ERROR(CheckTable(entries, block.frames.size()));
    block.tables.push_back(std::move(entries));
  }
  if (reader.failed() || reader.remaining() > 0) return Broken("cut short or too long");
  return block;
}

}  // namespace mapp
