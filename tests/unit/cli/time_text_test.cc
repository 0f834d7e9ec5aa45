#include "cli/time_text.h"

#include <gmock/gmock.h>

namespace mapp {
namespace {

constexpr int64_t kNsInSecond = 1'000'000'000;

TEST(TimeTextTest, ReadsWhatPeopleType) {
  const std::pair<std::string, int64_t> cases[] = {{"2026-11-23T15:00:00Z", 1'795'446'000},
                                                   {"2026-11-23 15:00:00", 1'795'446'000},
                                                   {"2026-11-23", 1'795'392'000},
                                                   {"2024-02-29T23:59:59Z", 1'709'251'199},
                                                   {"1795446000", 1'795'446'000},
                                                   {"1", 1},
                                                   {"1970-01-01T00:00:01Z", 1}};
  for (const auto& [text, seconds] : cases) {
    const StatusOr<int64_t> unix_ns = ParseUnixTime(text);
    ASSERT_TRUE(unix_ns.ok()) << text << ": " << unix_ns.status();
    EXPECT_EQ(*unix_ns, seconds * kNsInSecond) << text;
  }
}

TEST(TimeTextTest, RefusesTheRestAndSaysWhatItTakes) {
  for (const std::string text :
       {"", "yesterday", "2026-11-23T15:00:00", "2026-11-23T15:00:00+01:00", "2026-11-23T15:00Z", "2026-13-01",
        "2025-02-29", "2026-11-23T24:00:00Z", "2026-11-23T23:60:00Z", "23.11.2026", "-5", "1.5", " 2026-11-23",
        "2026-11-23 ", "99999999999999999999"}) {
    const Status status = ParseUnixTime(text).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(status.message()),
                testing::AllOf(testing::StartsWith(text + " is no time"), testing::HasSubstr("2026-11-23T15:00:00Z"),
                               testing::HasSubstr("Unix seconds")));
  }
}

TEST(TimeTextTest, RefusesTimesThatTheWireCannotSay) {
  for (const std::string text : {"0", "1970-01-01", "1969-12-31T23:59:59Z", "2300-01-01", "9999999999999"}) {
    EXPECT_THAT(ParseUnixTime(text).status().ToString(), testing::HasSubstr(text + " is out of range"));
  }
}

}  // namespace
}  // namespace mapp
