#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace mapp {

/// Adaptive probability of a bit, by counting (Krichevsky-Trofimov): for streams of a few thousand bits, in integers,
/// so that both sides count alike.
class BitModel {
 public:
  /// Share of `range` that stands for a 0; at least 1 and less than `range`, for range >= 2^24.
  uint32_t ZeroShare(uint32_t range) const { return range / (2 * (zeros_ + ones_) + 2) * (2 * zeros_ + 1); }
  void Count(bool bit) {
    ++(bit ? ones_ : zeros_);
    if (zeros_ + ones_ < kForgetAt) return;
    zeros_ /= 2;
    ones_ /= 2;
  }

 private:
  static constexpr uint32_t kForgetAt = 1U << 15;
  uint32_t zeros_ = 0;
  uint32_t ones_ = 0;
};

/// Binary range coder (Martin 1979, with the carry as in LZMA): close to the entropy under the models' probabilities.
class BitEncoder {
 public:
  void Put(bool bit, BitModel& model);
  /// The bytes, without zeros at the end: the decoder reads on as if they were there.
  std::string Finish() &&;

 private:
  void ShiftOut();

  std::string bytes_;
  uint64_t low_ = 0;
  uint32_t range_ = 0xffffffff;
  uint8_t held_byte_ = 0;  // may still get a carry, and so may the 0xff bytes after it
  uint64_t num_held_ = 1;
};

/// Reads what BitEncoder wrote; any other bytes yield some bits.
class BitDecoder {
 public:
  explicit BitDecoder(std::string_view bytes);
  bool Get(BitModel& model);

 private:
  uint32_t NextByte();

  std::string_view bytes_;
  size_t position_ = 0;
  uint32_t code_ = 0;
  uint32_t range_ = 0xffffffff;
};

}  // namespace mapp
