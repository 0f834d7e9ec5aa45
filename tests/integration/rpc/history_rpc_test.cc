// A map's past as an operator sees it: mapp maps log, diff, tag and show, against a real server.

#include "cli/compact.h"
#include "cli/map_history.h"
#include "cli/maps.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <sstream>

namespace mapp {
namespace {

using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

class HistoryRpcTest : public RpcTest {
 protected:
  void SetUp() override { Session(0); }

  /// A session of three keyframes around `place`; the first one founds the map.
  void Session(int place) {
    const SessionId session = Open();
    const Pose3 start = testing::SyntheticWorld::Stand(0, -2, 0);
    for (uint32_t number = 0; number < 3; ++number) {
      const Pose3 pose = testing::SyntheticWorld::Stand(0.2 * number + 0.1 * place, -2, 0);
      v1::UploadPartialKeyframeResponse response;
      const grpc::Status status = Upload(View(pose, start, session, number), response);
      ASSERT_TRUE(status.ok()) << status.error_message();
    }
  }

  StatusOr<std::string> Log(uint32_t max_runs = 20, bool json = false) {
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsLog({.server = address(), .name = "room", .max_runs = max_runs, .json = json}, out));
    return out.str();
  }
  StatusOr<std::string> Diff(const std::string& from, const std::string& to, bool json = false) {
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsDiff({.server = address(), .name = "room", .from = from, .to = to, .json = json}, out));
    return out.str();
  }
  StatusOr<std::string> Tag(MapsTagOptions options, const std::string& answer = {}) {
    options.server = address();
    options.name = "room";
    std::istringstream in(answer);
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsTag(options, in, out));
    return out.str();
  }
  StatusOr<std::string> Show(const std::string& at) {
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsShow({.server = address(), .name = "room", .at = at, .json = true}, out));
    return out.str();
  }
};

TEST_F(HistoryRpcTest, LogTellsWhatRevisionsWereMadeFor) {
  EXPECT_THAT(*Log(), ContainsRegex("1\\.\\.3 .* keyframe +3  1 "));
  Session(1);  // whose fragment may meanwhile have been aligned
  const auto both = AllOf(ContainsRegex("1\\.\\.3 .* keyframe +3  1 "), ContainsRegex("keyframe +[123]  2 "));
  EXPECT_THAT(*Log(), both);
  const StatusOr<std::string> newest = Log(1);
  EXPECT_THAT(*newest, AllOf(HasSubstr("older ones: see --limit"), Not(HasSubstr("1..3"))));
  EXPECT_THAT(*Log(1, true), HasSubstr("\"truncated\": true"));
  // A server that was stopped and started again tells the same.
  RestartServer();
  EXPECT_THAT(*Log(), both);
}

TEST_F(HistoryRpcTest, DiffCountsWhatEachSessionBrought) {
  EXPECT_THAT(*Diff("1", "3"), AllOf(HasSubstr("revision 1 -> 3"), ContainsRegex("\n1 [^\n]* 2  ")));
  EXPECT_THAT(*Diff("3", "3"), HasSubstr("no difference"));
  EXPECT_THAT(*Diff("0", "1", true), HasSubstr("\"frames_added\": 1"));
  EXPECT_THAT(Diff("3", "1").status().message(), HasSubstr("must not be later"));
  EXPECT_THAT(Diff("1", "999").status().message(), HasSubstr("no revision 999: its last one is"));
  EXPECT_THAT(Diff("spring", "").status().message(), HasSubstr("no tag \"spring\""));
}

TEST_F(HistoryRpcTest, TagsNameRevisionsEverywhere) {
  EXPECT_THAT(*Tag({.server = {}, .name = {}, .tag = "first-visit", .at = "3"}), HasSubstr("is revision 3"));
  EXPECT_THAT(*Tag({.server = {}, .name = {}, .tag = {}, .at = {}}), ContainsRegex("first-visit +3 "));
  EXPECT_THAT(*Log(), ContainsRegex("1\\.\\.3 .*first-visit@3"));
  EXPECT_THAT(*Show("first-visit"), AllOf(HasSubstr("\"revision\": 3"), HasSubstr("\"num_frames\": 3")));
  EXPECT_THAT(*Diff("first-visit", "3"), HasSubstr("no difference"));
  MapsTagOptions removal{.server = {}, .name = {}, .tag = "first-visit", .at = {}, .remove = true};
  EXPECT_THAT(Tag(removal).status().message(), HasSubstr("removing a tag needs --yes"));
  removal.interactive = true;
  EXPECT_THAT(Tag(removal, "n\n").status().message(), HasSubstr("no tag was removed"));
  EXPECT_TRUE(Show("first-visit").ok());
  EXPECT_THAT(*Tag(removal, "y\n"), AllOf(HasSubstr("Remove tag first-visit of revision 3?"), HasSubstr("removed")));
  removal.yes = true;
  EXPECT_THAT(Tag(removal).status().message(), HasSubstr("no tag \"first-visit\""));
  EXPECT_THAT(Show("first-visit").status().message(), HasSubstr("no tag \"first-visit\""));
  EXPECT_THAT(Tag({.server = {}, .name = {}, .tag = "12", .at = {}}).status().message(), HasSubstr("no number"));
  EXPECT_THAT(Tag({.server = {}, .name = {}, .tag = "x", .at = "999"}).status().message(),
              HasSubstr("no revision 999"));
}

TEST_F(HistoryRpcTest, ShowsTheMapAsItWas) {
  EXPECT_THAT(*Show("1"), AllOf(HasSubstr("\"revision\": 1"), HasSubstr("\"num_frames\": 1")));
  EXPECT_THAT(*Show("0"), AllOf(HasSubstr("\"num_frames\": 0"), HasSubstr("\"num_points\": 0")));
  EXPECT_EQ(*Show(""), *Show(fmt::format("{}", GetMap().revision())));
}

TEST_F(HistoryRpcTest, CompactDropsWhatNeedNotBeRead) {
  const auto compact = [this](CompactOptions options, const std::string& answer = {}) -> StatusOr<std::string> {
    options.server = address();
    std::istringstream in(answer);
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunCompact(options, {}, in, out));
    return out.str();
  };
  const CompactOptions one{.server = {}, .map_name = {}, .keep_revisions = 1, .keep_days = {}};
  CompactOptions dry = one, asked = one, sure = one, elsewhere = one;
  dry.dry_run = asked.interactive = sure.yes = true;
  EXPECT_THAT(*compact(dry), ContainsRegex("room +0 -> 2"));
  EXPECT_THAT(compact(one).status().message(), HasSubstr("needs --yes"));
  EXPECT_THAT(compact(asked, "n\n").status().message(), HasSubstr("nothing was dropped"));
  EXPECT_TRUE(Show("1").ok());
  EXPECT_THAT(*compact(asked, "y\n"), ContainsRegex("room +0 -> 2"));
  EXPECT_THAT(Show("1").status().message(), HasSubstr("compacted away: the oldest one kept is 2"));
  EXPECT_THAT(*Show("2"), HasSubstr("\"num_frames\": 2"));
  EXPECT_THAT(*Log(), HasSubstr("compacted: the oldest to be read is 2"));
  sure.json = true;
  EXPECT_THAT(*compact(sure), AllOf(HasSubstr("\"oldest_revision\": 2"), HasSubstr("\"num_rows\": 0")));
  elsewhere.map_name = "cellar";
  EXPECT_THAT(compact(elsewhere).status().message(), HasSubstr("\"cellar\" does not exist"));
  EXPECT_THAT(compact({}).status().message(), HasSubstr("say what to keep"));
}

}  // namespace
}  // namespace mapp
