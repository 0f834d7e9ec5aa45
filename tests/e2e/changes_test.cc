// A parking garage before and after cars have left: found, shown, applied and taken back with the real programs.

#include "tests/e2e/service_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace mapp {
namespace {

using testing::HasSubstr;

/// Two visits before three of the cars on the way have left, one after.
constexpr const char* kGarage =
    "sim:garage:users=3,path=30,rate=10,seed=1,sensor=rgbd,routes=1,changes=3,changes-near=8,change-kinds=vanished,"
    "stable=2";

class ChangesOfTheWorldTest : public ServiceTest {
 protected:
  void VisitAll() {
    StartServer();
    for (int visit = 0; visit < 3; ++visit) {
      const std::string name = "visit" + std::to_string(visit);
      const Replayed replayed = Replay(std::string(kGarage) + "/" + std::to_string(visit), name,
                                       {"--level", "features", "--policy", "upload_all"});
      ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
    }
  }
  std::vector<std::string> OnMap(std::vector<std::string> command) const {
    command.insert(command.begin(), "changes");
    command.insert(command.end(), {"--map", "place", "--server", server_address_});
    return command;
  }
  Finished Run(const std::vector<std::string>& command) {
    server_address_ = server().address();
    return RunMapp(OnMap(command));
  }
  double NumPoints() {
    const Finished maps = RunMapp({"maps", "list", "--json", "--server", server().address()});
    return JsonNumber(maps.out, "num_points").value_or(-1);
  }

 private:
  std::string server_address_;
};

TEST_F(ChangesOfTheWorldTest, WhatHasLeftIsFoundAppliedAndBroughtBack) {
  ASSERT_NO_FATAL_FAILURE(VisitAll());
  const Finished detected = Run({"detect", "--json"});
  ASSERT_EQ(detected.exit_code, 0) << detected.err;
  ASSERT_GE(JsonNumber(detected.out, "num_new").value_or(0), 1) << detected.out;
  EXPECT_THAT(detected.out, HasSubstr("vanished"));
  EXPECT_EQ(JsonNumber(detected.out, "num_sessions_read"), 3);
  const Finished again = Run({"detect", "--json"});
  EXPECT_EQ(JsonNumber(again.out, "num_new"), 0);
  EXPECT_EQ(JsonNumber(again.out, "num_sessions_read"), 0);

  const std::string picture = folder().File("before_after.png"), cloud = folder().File("changes.ply");
  EXPECT_EQ(Run({"render", "--before-after", "--out", picture}).exit_code, 0);
  EXPECT_EQ(Run({"export", "--out", cloud}).exit_code, 0);
  EXPECT_GT(std::filesystem::file_size(picture), 1000U);
  EXPECT_GT(std::filesystem::file_size(cloud), 1000U);

  const double before = NumPoints();
  const Finished accepted = Run({"accept", "1"});
  ASSERT_EQ(accepted.exit_code, 0) << accepted.err;
  EXPECT_LT(NumPoints(), before);
  // What was applied is there after a crash.
  KillAndRestartServer();
  EXPECT_THAT(Run({"list"}).out, HasSubstr("accepted"));
  const Finished undone = Run({"undo", "1"});
  ASSERT_EQ(undone.exit_code, 0) << undone.err;
  EXPECT_EQ(NumPoints(), before);
  EXPECT_EQ(server().Stop(), 0);
  const Finished verified = RunMapp({"verify", "--db", database()});
  EXPECT_EQ(verified.exit_code, 0) << verified.out;
}

}  // namespace
}  // namespace mapp
