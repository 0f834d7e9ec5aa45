#include "cli/sequence_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

TEST(ParseRoomSpecTest, ReadsSessionAndSeed) {
  ASSERT_TRUE(ParseRoomSpec("sim:room/0").has_value());
  EXPECT_EQ(ParseRoomSpec("sim:room/1")->session, 1);
  EXPECT_EQ(ParseRoomSpec("sim:room/1")->seed, RoomSpec().seed);
  EXPECT_EQ(ParseRoomSpec("sim:room:77/2")->seed, 77);
  EXPECT_EQ(ParseRoomSpec("sim:room:77/2")->session, 2);
}

TEST(ParseRoomSpecTest, RefusesEverythingElse) {
  for (const char* text :
       {"", "sim:", "sim:room", "sim:room/", "sim:room/x", "sim:room/-1", "sim:room/1/2", "sim:room:/1", "sim:room:x/1",
        "sim:cellar/0", "sim:room/99999999999", "room/0", "sim:room/ 1"}) {
    EXPECT_FALSE(ParseRoomSpec(text).has_value()) << text;
  }
}

TEST(OpenSequenceSourceTest, NamesTheSimulationItDoesNotKnow) {
  const Status status = OpenSequenceSource("sim:cellar/0").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("sim:cellar/0"));
}

TEST(OpenSequenceSourceTest, NamesTheFolderThatIsNotThere) {
  const Status status = OpenSequenceSource("/no/such/sequence").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()), HasSubstr("/no/such/sequence"));
}

}  // namespace
}  // namespace mapp
