#include "text/json_writer.h"

#include <gtest/gtest.h>

#include <limits>

namespace mapp {
namespace {

template <typename T>
std::string Written(const T& value) {
  JsonWriter json;
  json.Value(value);
  return std::move(json).Finish();
}

TEST(JsonWriterTest, NestsAndIndents) {
  JsonWriter json;
  json.BeginObject().Field("a", 1).Key("b").BeginArray().Value("x").Value(true).EndArray();
  json.Key("c").BeginObject().EndObject().EndObject();
  EXPECT_EQ(std::move(json).Finish(), "{\n  \"a\": 1,\n  \"b\": [\n    \"x\",\n    true\n  ],\n  \"c\": {}\n}\n");
}

TEST(JsonWriterTest, EscapesWhatJsonReserves) {
  EXPECT_EQ(Written("say \"hi\"\\\n\t\x01"), "\"say \\\"hi\\\"\\\\\\n\\u0009\\u0001\"\n");
}

TEST(JsonWriterTest, EscapesKeys) {
  JsonWriter json;
  json.BeginObject().Field("a\"b", 1).EndObject();
  EXPECT_EQ(std::move(json).Finish(), "{\n  \"a\\\"b\": 1\n}\n");
}

TEST(JsonWriterTest, KeepsUtf8) { EXPECT_EQ(Written("Küche 厨房 🍳"), "\"Küche 厨房 🍳\"\n"); }

TEST(JsonWriterTest, ReplacesBytesThatAreNotUtf8) {
  EXPECT_EQ(Written("a\xff"
                    "b"),
            "\"a\\ufffdb\"\n");
  EXPECT_EQ(Written("\xc0\xaf"), "\"\\ufffd\\ufffd\"\n") << "overlong";
  EXPECT_EQ(Written("\xe0\x80\x80").substr(0, 7), "\"\\ufffd") << "overlong";
  EXPECT_EQ(Written("\xed\xa0\x80").substr(0, 7), "\"\\ufffd") << "surrogate";
  EXPECT_EQ(Written("\xf4\x90\x80\x80").substr(0, 7), "\"\\ufffd") << "beyond U+10FFFF";
  EXPECT_EQ(Written("\xe5\x8e"), "\"\\ufffd\\ufffd\"\n") << "cut off";
}

TEST(JsonWriterTest, NumbersReadBackExactly) {
  EXPECT_EQ(Written(0.1), "0.1\n");
  EXPECT_EQ(Written(1.2F), "1.2\n") << "as a float";
  EXPECT_EQ(Written(1e300), "1e+300\n");
  EXPECT_EQ(Written(-2.5), "-2.5\n");
  EXPECT_EQ(Written(std::numeric_limits<uint64_t>::max()), "18446744073709551615\n");
  EXPECT_EQ(Written(std::numeric_limits<int64_t>::min()), "-9223372036854775808\n");
}

TEST(JsonWriterTest, WritesNullForWhatIsAbsentOrNotFinite) {
  EXPECT_EQ(Written(std::numeric_limits<double>::quiet_NaN()), "null\n");
  EXPECT_EQ(Written(std::numeric_limits<double>::infinity()), "null\n");
  EXPECT_EQ(Written(std::optional<int>()), "null\n");
  EXPECT_EQ(Written(std::optional<int>(7)), "7\n");
}

TEST(JsonWriterDeathTest, RefusesAValueWithoutAKeyInAnObject) {
  JsonWriter json;
  json.BeginObject();
  EXPECT_DEATH(json.Value(1), "check failed");
}

}  // namespace
}  // namespace mapp
