#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// How a place index makes words of descriptors: `num_tables` choices of `bits_per_key` of their bits, drawn by `seed`.
struct PlaceWords {
  static constexpr int kMinBits = 8;
  static constexpr int kMaxBits = 20;

  int num_tables = 2;
  /// More bits make a collision say more and happen less often.
  int bits_per_key = kMaxBits;
  uint64_t seed = 7;

  bool operator==(const PlaceWords&) const = default;
};

/// What a place index knows of some frames, ready to be stored: docs/formats/place_block.md.
struct PlaceBlock {
  static constexpr int kPositionBits = 32 - PlaceWords::kMaxBits;
  static constexpr size_t kMaxFrames = size_t{1} << kPositionBits;

  struct Frame {
    uint64_t id = 0;
    uint32_t num_features = 0;
  };
  PlaceWords words;
  std::vector<Frame> frames;  ///< at most kMaxFrames
  /// Per table, ascending and each once: a key, and in the low kPositionBits the position of a frame that holds it.
  std::vector<std::vector<uint32_t>> tables;
};

std::string EncodePlaceBlock(const PlaceBlock& block);
/// DATA_LOSS: not a block, cut short, of another version or with a wrong checksum.
StatusOr<PlaceBlock> DecodePlaceBlock(std::string_view bytes);

}  // namespace mapp
