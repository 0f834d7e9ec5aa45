#include "mapp/base/bytes.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <limits>

namespace mapp {
namespace {

TEST(BytesTest, Crc32cMatchesThePublishedCheckValue) { EXPECT_EQ(Crc32c("123456789"), 0xe3069283U); }

TEST(BytesTest, Crc32cGoesOnWhereItEnded) {
  const std::string bytes = "what was computed in two steps is what one step gives";
  for (size_t cut = 0; cut <= bytes.size(); ++cut) {
    EXPECT_EQ(ExtendCrc32c(Crc32c(bytes.substr(0, cut)), bytes.substr(cut)), Crc32c(bytes)) << cut;
  }
}

TEST(BytesTest, Crc32cIsTheSameAtEveryLength) {
  Rng rng(6);
  std::string bytes;
  for (int length = 0; length < 100; ++length) {
    // Bit by bit, from the polynomial.
    uint32_t expected = 0xffffffffU;
    for (const char c : bytes) {
      expected ^= static_cast<uint8_t>(c);
      for (int bit = 0; bit < 8; ++bit) expected = (expected >> 1) ^ ((expected & 1) != 0 ? 0x82f63b78U : 0);
    }
    EXPECT_EQ(Crc32c(bytes), ~expected) << length;
    bytes.push_back(static_cast<char>(rng.Next()));
  }
}

TEST(BytesTest, VarintRoundTripsAtEveryLength) {
  for (int shift = 0; shift < 64; ++shift) {
    for (const uint64_t value : {uint64_t{1} << shift, (uint64_t{1} << shift) - 1}) {
      ByteWriter writer;
      writer.PutVarint(value);
      ByteReader reader(writer.bytes());
      EXPECT_EQ(reader.GetVarint(), value);
      EXPECT_FALSE(reader.failed());
      EXPECT_EQ(reader.remaining(), 0U);
    }
  }
}

TEST(BytesTest, ReadingPastTheEndFailsAndYieldsZeros) {
  ByteReader reader("ab");
  EXPECT_EQ(reader.Get<uint32_t>(), 0U);
  EXPECT_TRUE(reader.failed());
  EXPECT_EQ(reader.Get<uint8_t>(), 0);
  EXPECT_TRUE(reader.GetBytes(1).empty());
}

TEST(BytesTest, AnUnendingVarintFails) {
  const std::string bytes(11, '\xff');
  ByteReader reader(bytes);
  reader.GetVarint();
  EXPECT_TRUE(reader.failed());
}

TEST(BytesTest, ZigZagRoundTrips) {
  Rng rng(5);
  for (int i = 0; i < 1000; ++i) {
    const auto value = static_cast<int64_t>(rng.Next());
    EXPECT_EQ(UnZigZag(ZigZag(value)), value);
  }
  EXPECT_EQ(ZigZag(-1), 1U);
  EXPECT_EQ(ZigZag(1), 2U);
  EXPECT_EQ(UnZigZag(ZigZag(std::numeric_limits<int64_t>::min())), std::numeric_limits<int64_t>::min());
}

}  // namespace
}  // namespace mapp
