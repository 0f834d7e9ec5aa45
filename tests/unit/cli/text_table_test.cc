#include "cli/text_table.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

TEST(TextTableTest, AlignsColumnsByTheirWidestCell) {
  TextTable table({{"name"}, {"points", Align::kRight}, {"note"}});
  table.AddRow({"kitchen", "12", ""});
  table.AddRow({"a", "123456789", "x"});
  EXPECT_EQ(table.Format(),
            "name        points  note\n"
            "kitchen         12\n"
            "a        123456789  x\n");
}

TEST(TextTableTest, CountsCharactersNotBytes) {
  TextTable table({{"name"}, {"n"}});
  table.AddRow({"Küche", "1"});
  EXPECT_EQ(table.Format(), "name   n\nKüche  1\n");
}

TEST(FormatUnixTimeTest, WritesUtcAndADashForNever) {
  EXPECT_EQ(FormatUnixTime(1'700'000'000'123'456'789), "2023-11-14 22:13:20");
  EXPECT_EQ(FormatUnixTime(0), "-");
}

TEST(FormatBytesTest, ChoosesTheUnit) {
  EXPECT_EQ(FormatBytes(0), "0 B");
  EXPECT_EQ(FormatBytes(999), "999 B");
  EXPECT_EQ(FormatBytes(40'321), "40.3 KB");
  EXPECT_EQ(FormatBytes(1'234'567), "1.2 MB");
}

}  // namespace
}  // namespace mapp
