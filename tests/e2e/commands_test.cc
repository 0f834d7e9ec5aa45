// An operator's round: every command that asks a server or a database, as typed, with --json; and what deletes without
// being asked to is not done where nobody can be asked.

#include "eval/harness/figures.h"
#include "tests/e2e/service_fixture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;
using Arguments = std::vector<std::string>;

class CommandsTest : public ServiceTest {
 protected:
  void SetUp() override {
    StartServer();
    Replay("sim:room/0", "device", {"--level", "features"});
  }

  static Arguments With(Arguments arguments, const Arguments& more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  Arguments OnServer(const Arguments& arguments) { return With(arguments, {"--server", server().address()}); }
  /// One JSON document on standard output.
  static std::string RunForJson(const Arguments& arguments) {
    const std::string typed = fmt::format("mapp {}", fmt::join(arguments, " "));
    const Finished finished = RunMapp(With(arguments, {"--json"}));
    EXPECT_EQ(finished.exit_code, 0) << typed << ": " << finished.err;
    const StatusOr<Figures> parsed = Figures::Parse(finished.out, typed);
    EXPECT_TRUE(parsed.ok()) << typed << ": " << parsed.status() << '\n' << finished.out;
    return finished.out;
  }
  std::string database() const { return folder().File("map.db"); }
};

TEST_F(CommandsTest, AnswerInJson) {
  const std::string bundle = folder().File("place.mappbundle");
  const std::string backup = folder().File("backup.db");
  for (const Arguments& arguments : {
           Arguments{"maps", "list"},
           {"maps", "show", "place"},
           {"maps", "log", "place"},
           {"maps", "diff", "place", "1"},
           {"maps", "tag", "place", "first"},
           {"maps", "tag", "place"},
           {"maps", "optimize", "place"},
           {"maps", "export", "place", "--bundle", bundle},
           {"maps", "import", "--bundle", bundle, "--as", "copy"},
           {"maps", "import", "--bundle", bundle, "--dry-run"},
           {"sessions", "list"},
           {"sessions", "show", "1"},
           {"server-info"},
           {"verify"},
           {"changes", "detect", "--map", "place"},
           {"changes", "list", "--map", "place"},
           {"compact", "--keep-revisions", "1", "--dry-run"},
           {"compact", "--keep-revisions", "1", "--yes"},
           {"export", "--map", "place", "--format", "ply", "--out", folder().File("place.ply")},
           {"export", "--map", "place", "--format", "tum", "--out", folder().File("place-tum")},
           {"render", "--map", "place", "--out", folder().File("place.png")},
           {"maps", "tag", "place", "first", "--remove", "--yes"},
           {"maps", "delete", "copy", "--yes"},
       }) {
    RunForJson(OnServer(arguments));
  }
  for (const Arguments& arguments : {
           Arguments{"backup", "--db", database(), "--to", backup, "--dry-run"},
           {"backup", "--db", database(), "--to", backup},
           {"verify", "--db", backup},
           {"restore", backup, "--db", folder().File("restored.db"), "--dry-run"},
           {"restore", backup, "--db", folder().File("restored.db")},
           {"simulate", "room", "--out", folder().File("room")},
           {"simulate", "garage", "--users", "1", "--path", "3", "--out", folder().File("garage")},
       }) {
    RunForJson(arguments);
  }
}

TEST_F(CommandsTest, WhatDeletesNeedsAYes) {
  EXPECT_EQ(RunMapp(OnServer({"maps", "tag", "place", "first"})).exit_code, 0);
  const std::string before = RunForJson(OnServer({"maps", "log", "place"}));
  EXPECT_THAT(ExpectFailure(OnServer({"maps", "delete", "place"})), HasSubstr("deleting a map needs --yes"));
  EXPECT_THAT(ExpectFailure(OnServer({"maps", "tag", "place", "first", "--remove"})),
              HasSubstr("removing a tag needs --yes"));
  EXPECT_THAT(ExpectFailure(OnServer({"compact", "--keep-revisions", "1"})), HasSubstr("dropping history needs --yes"));
  const std::string backup = folder().File("backup.db");
  const std::string other = folder().File("other.db");
  EXPECT_EQ(RunMapp({"backup", "--db", database(), "--to", backup}).exit_code, 0);
  EXPECT_EQ(RunMapp({"backup", "--db", database(), "--to", other}).exit_code, 0);
  EXPECT_THAT(ExpectFailure({"restore", backup, "--db", other}), HasSubstr("replacing a database needs --yes"));
  EXPECT_EQ(RunForJson(OnServer({"maps", "log", "place"})), before);
}

}  // namespace
}  // namespace mapp
