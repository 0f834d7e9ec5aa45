#include "cli/change_text.h"

#include "change_scene.h"

#include <gmock/gmock.h>

namespace mapp {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

std::vector<std::string> LinesOf(const std::string& text) {
  std::vector<std::string> lines;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = text.find('\n', begin);
    lines.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return lines;
}

TEST(ChangeTextTest, TableHasALineAChange) {
  const std::vector<std::string> lines = LinesOf(FormatChangeTable(ChangeScene().changes));
  ASSERT_EQ(lines.size(), 6U);
  EXPECT_THAT(lines[0], StartsWith("id  kind      status    confidence  where (m)"));
  EXPECT_THAT(lines[1],
              AllOf(StartsWith(" 1  vanished  proposed        0.97  2.00 -0.40 2.00 "), HasSubstr("0.90 x 0.80 x 0.60"),
                    HasSubstr("2026-11-23 08:00:00   2026-11-23 11:00:00"), testing::EndsWith("60  1 2 5")));
  EXPECT_THAT(lines[3], AllOf(StartsWith(" 3  moved     proposed        0.91  1.50 -0.50 4.60 -> 4.20 -0.50 3.20  "),
                              HasSubstr("40 -> 40")));
  EXPECT_THAT(lines[4], StartsWith("12  vanished  accepted"));
}

TEST(ChangeTextTest, TableCutsLongListsOfSessionsShort) {
  ChangeSummary change = ChangeScene().changes[0];
  change.session_ids = {1, 2, 3, 4, 5, 6};
  EXPECT_THAT(FormatChangeTable({change}), HasSubstr("1 2 3 4 5 6\n"));
  change.session_ids = {1, 2, 3, 4, 5, 6, 7};
  EXPECT_THAT(FormatChangeTable({change}), HasSubstr("1 2 3 4 5 and 2 more\n"));
  EXPECT_THAT(FormatChange(change), HasSubstr("1 2 3 4 5 6 7\n"));
}

TEST(ChangeTextTest, ShowsEverythingOfOne) {
  const std::string text = FormatChange(ChangeScene().changes[2]);
  EXPECT_THAT(text, AllOf(StartsWith("change "), HasSubstr("confidence "), HasSubstr("0.910\n"),
                          HasSubstr("first seen (UTC)"), HasSubstr("2026-11-22 08:00:00\n"),
                          HasSubstr("last seen (UTC)"), HasSubstr("centre before (m)"), HasSubstr("centre after (m)")));
  EXPECT_THAT(text, AllOf(HasSubstr("4.20 -0.50 3.20\n"), HasSubstr("0.8192 0.0000 0.5736 0.0000\n"),
                          HasSubstr("points before (40)"), HasSubstr("5201 5202 5203"), HasSubstr("5340\n")));
  EXPECT_THAT(text, HasSubstr("applied at revision        -\n"));
  EXPECT_THAT(FormatChange(ChangeScene().changes[0]), Not(HasSubstr("centre after")));
}

TEST(ChangeTextTest, JsonHasEverything) {
  JsonWriter json;
  AppendChange(ChangeScene().changes[3], json);
  const std::string text = std::move(json).Finish();
  EXPECT_THAT(text, AllOf(HasSubstr("\"id\": 12"), HasSubstr("\"kind\": \"vanished\""),
                          HasSubstr("\"status\": \"accepted\""), HasSubstr("\"confidence\": 0.99"),
                          HasSubstr("\"after_unix_ns\": 1795420800000000000"), HasSubstr("\"applied_revision\": 41"),
                          HasSubstr("\"box_after\": null"), HasSubstr("\"pose_map_box\"")));
  EXPECT_THAT(text, AllOf(HasSubstr("\"session_ids\": [\n"), HasSubstr("5440"), HasSubstr("\"points_after\": []")));
}

}  // namespace
}  // namespace mapp
