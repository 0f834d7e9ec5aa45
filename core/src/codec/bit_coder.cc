#include "bit_coder.h"

namespace mapp {
namespace {

constexpr uint32_t kLeastRange = 1U << 24;

}  // namespace

void BitEncoder::Put(bool bit, BitModel& model) {
  const uint32_t zero_share = model.ZeroShare(range_);
  if (bit) {
    low_ += zero_share;
    range_ -= zero_share;
  } else {
    range_ = zero_share;
  }
  while (range_ < kLeastRange) {
    range_ <<= 8;
    ShiftOut();
  }
  model.Count(bit);
}

void BitEncoder::ShiftOut() {
  const bool carry = low_ > 0xffffffff;
  if (low_ < 0xff000000 || carry) {
    for (; num_held_ > 0; --num_held_) {
      bytes_.push_back(static_cast<char>(static_cast<uint8_t>(held_byte_ + (carry ? 1 : 0))));
      held_byte_ = 0xff;
    }
    held_byte_ = static_cast<uint8_t>(low_ >> 24);
  }
  ++num_held_;
  low_ = (low_ & 0x00ffffff) << 8;
}

std::string BitEncoder::Finish() && {
  for (int i = 0; i < 5; ++i) ShiftOut();
  bytes_.erase(0, 1);  // what was held at first: always zero
  const size_t last = bytes_.find_last_not_of('\0');
  bytes_.resize(last == std::string::npos ? 0 : last + 1);
  return std::move(bytes_);
}

BitDecoder::BitDecoder(std::string_view bytes) : bytes_(bytes) {
  for (int i = 0; i < 4; ++i) code_ = code_ << 8 | NextByte();
}

bool BitDecoder::Get(BitModel& model) {
  const uint32_t zero_share = model.ZeroShare(range_);
  const bool bit = code_ >= zero_share;
  if (bit) {
    code_ -= zero_share;
    range_ -= zero_share;
  } else {
    range_ = zero_share;
  }
  while (range_ < kLeastRange) {
    range_ <<= 8;
    code_ = code_ << 8 | NextByte();
  }
  model.Count(bit);
  return bit;
}

uint32_t BitDecoder::NextByte() {
  if (position_ >= bytes_.size()) return 0;
  return static_cast<uint8_t>(bytes_[position_++]);
}

}  // namespace mapp
