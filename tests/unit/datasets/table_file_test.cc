#include "datasets/table_file.h"

#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(TableFileTest, SkipsCommentsAndBlankLinesAndKeepsLineNumbers) {
  const test::TempFolder folder;
  const std::string file = folder.Write("list.txt", "# head\n\n1.5   a.jpg\r\n  # more\n2.5\tb.jpg");
  const auto rows = ReadTable(file, ' ', 2);
  ASSERT_TRUE(rows.ok()) << rows.status();
  ASSERT_EQ(rows->size(), 2);
  EXPECT_EQ((*rows)[0].line, 3);
  EXPECT_THAT((*rows)[0].fields, ElementsAre("1.5", "a.jpg"));
  EXPECT_EQ((*rows)[1].line, 5);
  EXPECT_THAT((*rows)[1].fields, ElementsAre("2.5", "b.jpg"));
}

TEST(TableFileTest, SplitsAtCommas) {
  const test::TempFolder folder;
  const auto rows = ReadTable(folder.Write("data.csv", "#t,f\n12, a b.png\r\n"), ',', 2);
  ASSERT_TRUE(rows.ok()) << rows.status();
  EXPECT_THAT(rows->at(0).fields, ElementsAre("12", "a b.png"));
}

TEST(TableFileTest, NamesFileAndLineOfAShortRow) {
  const test::TempFolder folder;
  const std::string file = folder.Write("list.txt", "1 a\n2\n");
  const Status status = ReadTable(file, ' ', 2).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr(file + ":2: "));
}

TEST(TableFileTest, ReportsAMissingFile) {
  const Status status = ReadTable("/nowhere/list.txt", ' ', 2).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/nowhere/list.txt"));
}

TEST(ParseSecondsTest, KeepsNanosecondsOfTimesSince1970) {
  EXPECT_EQ(ParseSeconds("1403638546.077829376"), 1403638546077829376);
  EXPECT_EQ(ParseSeconds("0.066667"), 66667000);
  EXPECT_EQ(ParseSeconds("12"), 12'000'000'000);
  EXPECT_EQ(ParseSeconds("12."), 12'000'000'000);
  EXPECT_EQ(ParseSeconds("1.0000000009"), 1'000'000'000);
}

TEST(ParseSecondsTest, RejectsWhatIsNoTime) {
  for (const char* text : {"", ".", "-1", "1e3", "1.2.3", "1.2x", "x", "nan", "9000000001", "99999999999999999999"}) {
    EXPECT_EQ(ParseSeconds(text), std::nullopt) << "'" << text << "'";
  }
}

TEST(ParseNumberTest, TakesFiniteNumbersOnly) {
  EXPECT_EQ(ParseNumber("-1.5e-3"), -1.5e-3);
  for (const char* text : {"", "nan", "inf", "1,5", "1 ", "0x10"}) EXPECT_EQ(ParseNumber(text), std::nullopt) << text;
}

TEST(ParseNanosecondsTest, RejectsNegativeAndFractionalTimes) {
  EXPECT_EQ(ParseNanoseconds("1403638546077829376"), 1403638546077829376);
  for (const char* text : {"", "-5", "1.5", "9223372036854775808"}) EXPECT_EQ(ParseNanoseconds(text), std::nullopt);
}

}  // namespace
}  // namespace mapp
