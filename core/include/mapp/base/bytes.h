#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

namespace mapp {

/// Appends little-endian values to a byte string. Every binary format of the project is written through it.
class ByteWriter {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void Put(T value) {
    static_assert(std::endian::native == std::endian::little, "add byte swaps for big-endian hosts");
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    bytes_.append(raw, sizeof(T));
  }
  /// LEB128: 7 bits a byte, low first.
  void PutVarint(uint64_t value);
  void PutBytes(std::string_view bytes) { bytes_.append(bytes); }
  size_t size() const { return bytes_.size(); }
  const std::string& bytes() const { return bytes_; }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads what ByteWriter wrote. Reading past the end sets `failed()` and yields zeros from then on, so a decoder can
/// read a whole record and check once; it must check before it trusts a count.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  requires std::is_arithmetic_v<T> T Get() {
    T value{};
    if (remaining() < sizeof(T)) {
      Fail();
      return value;
    }
    std::memcpy(&value, bytes_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  uint64_t GetVarint();
  std::string_view GetBytes(size_t count);
  size_t remaining() const { return bytes_.size() - position_; }
  size_t position() const { return position_; }
  bool failed() const { return failed_; }

 private:
  void Fail() {
    failed_ = true;
    position_ = bytes_.size();
  }
  std::string_view bytes_;
  size_t position_ = 0;
  bool failed_ = false;
};

/// Maps small magnitudes of either sign to small unsigned numbers, for varints.
constexpr uint64_t ZigZag(int64_t value) {
  return (static_cast<uint64_t>(value) << 1) ^ static_cast<uint64_t>(value >> 63);
}
constexpr int64_t UnZigZag(uint64_t value) {
  return static_cast<int64_t>(value >> 1) ^ -static_cast<int64_t>(value & 1);
}

/// CRC-32C (Castagnoli, polynomial 0x1EDC6F41, reflected), as iSCSI and LevelDB use it.
uint32_t Crc32c(std::string_view bytes);
/// Of what `crc` is the checksum of (0: of nothing), followed by `bytes`.
uint32_t ExtendCrc32c(uint32_t crc, std::string_view bytes);

}  // namespace mapp
