// What every command of `mapp` must have for an operator to live with it. Commands are found by walking over them: one
// that joins is held to the same.

#include "cli/commands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <regex>
#include <sstream>
#include <vector>

namespace mapp {
namespace {

using ::testing::StartsWith;

/// The command line as the program makes it.
struct CommandLine {
  CommandLine() { AddCommands(app, "mapp", chosen); }

  CLI::App app{"", "mapp"};
  Command chosen;
};

struct Leaf {
  std::string path;  ///< "mapp maps list"
  CLI::App* app = nullptr;
};

void AddLeaves(CLI::App& app, const std::string& path, std::vector<Leaf>& leaves) {
  const std::vector<CLI::App*> below = app.get_subcommands(/*filter=*/nullptr);
  if (below.empty()) leaves.push_back({path, &app});
  for (CLI::App* const command : below) AddLeaves(*command, path + ' ' + command->get_name(), leaves);
}

/// The commands that do something, those below `mapp maps` and the like included.
std::vector<Leaf> LeavesOf(CommandLine& line) {
  std::vector<Leaf> leaves;
  AddLeaves(line.app, "mapp", leaves);
  return leaves;
}

std::vector<std::string> ExamplesIn(const std::string& help) {
  std::vector<std::string> examples;
  std::istringstream lines(help);
  constexpr std::string_view kBegin = "Example: ";
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(kBegin)) examples.push_back(line.substr(kBegin.size()));
  }
  return examples;
}

std::string LastLine(const std::string& text) {
  const size_t end = text.find_last_not_of("\n ");
  const size_t begin = text.rfind('\n', end);
  return text.substr(begin + 1, end - begin);
}

/// What the parser says of a command line without quotes; empty when it is content and there is something to run.
std::string Complaint(const std::string& command_line) {
  std::istringstream words(command_line);
  std::vector<std::string> arguments(std::istream_iterator<std::string>(words), {});
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
  arguments.pop_back();                              // "mapp"
  CommandLine line;
  try {
    line.app.parse(arguments);
  } catch (const CLI::ParseError& error) {
    return error.get_name() + ": " + error.what();
  }
  return line.chosen ? "" : "nothing to run";
}

TEST(CommandsTest, WalkFindsThem) {
  CommandLine line;
  std::vector<std::string> paths;
  for (const Leaf& leaf : LeavesOf(line)) paths.push_back(leaf.path);
  EXPECT_THAT(paths, ::testing::IsSupersetOf({"mapp maps list", "mapp maps import", "mapp sessions release",
                                              "mapp simulate garage", "mapp eval", "mapp restore"}));
}

TEST(CommandsTest, HelpEndsWithAnExampleThatParses) {
  CommandLine line;
  for (const Leaf& leaf : LeavesOf(line)) {
    SCOPED_TRACE(leaf.path);
    const std::string help = leaf.app->help();
    EXPECT_THAT(LastLine(help), StartsWith("Example: " + leaf.path));
    for (const std::string& example : ExamplesIn(help)) {
      EXPECT_THAT(example, StartsWith(leaf.path + ' '));
      EXPECT_EQ(Complaint(example), "") << example;
    }
  }
  EXPECT_NE(Complaint("mapp maps show"), "") << "or nothing would be complained of";
  EXPECT_NE(Complaint("mapp maps list --fast"), "");
}

TEST(CommandsTest, ChangesSayWhatIsWrongWithWhatIsTyped) {
  using ::testing::AllOf;
  using ::testing::HasSubstr;
  EXPECT_THAT(
      Complaint("mapp changes detect --map m --from yesterday"),
      AllOf(HasSubstr("--from: yesterday is no time"), HasSubstr("2026-11-23T15:00:00Z"), HasSubstr("Unix seconds")));
  EXPECT_THAT(Complaint("mapp changes detect --map m --to 1970-01-01"), HasSubstr("--to: 1970-01-01 is out of range"));
  for (const std::string confidence : {"0", "1.1", "-0.5", "nan", "sure"}) {
    EXPECT_THAT(Complaint("mapp changes detect --map m --auto-accept=" + confidence),
                HasSubstr(confidence + " is no confidence"));
  }
  EXPECT_EQ(Complaint("mapp changes detect --map m --auto-accept 1 --to 1795446000"), "");
  EXPECT_THAT(Complaint("mapp changes list --map m --kind stolen"),
              HasSubstr("--kind: stolen is not one of appeared, vanished, moved"));
  EXPECT_THAT(Complaint("mapp changes list --map m --status new"), HasSubstr("one of proposed, accepted, rejected"));
  EXPECT_THAT(Complaint("mapp changes render --map m --out a.gif"),
              HasSubstr("--out: a.gif: the name must end in .png"));
  EXPECT_THAT(Complaint("mapp changes export --map m --out a.csv"), HasSubstr(".json, .geojson or .ply"));
  EXPECT_NE(Complaint("mapp changes accept --map m"), "") << "no ids";
  EXPECT_THAT(Complaint("mapp changes accept --map m -1"), HasSubstr("-1 is no change: give its number"));
  EXPECT_THAT(Complaint("mapp changes undo --map m 3 0"), HasSubstr("0 is no change"));
  EXPECT_NE(Complaint("mapp changes undo 3"), "") << "no map";
  EXPECT_EQ(Complaint("mapp changes reject 3 4 --map m"), "");
}

TEST(CommandsTest, EveryoneGivesJson) {
  CommandLine line;
  for (const Leaf& leaf : LeavesOf(line)) {
    EXPECT_NE(leaf.app->get_option_no_throw("--json"), nullptr) << leaf.path;
  }
}

TEST(CommandsTest, WhatDeletesAsksOrCanBeTried) {
  // Whoever deletes says so in the help.
  const std::regex deletes("\\b(delet|drop|eras|forget|remov|revert|take away|put .* in .* place)",
                           std::regex::ECMAScript | std::regex::icase);
  CommandLine line;
  std::vector<std::string> paths;
  for (const Leaf& leaf : LeavesOf(line)) {
    std::string text = leaf.app->get_description();
    for (const CLI::Option* option : leaf.app->get_options()) {
      text += '\n' + option->get_name() + ' ' + option->get_description();
    }
    if (!std::regex_search(text, deletes)) continue;
    paths.push_back(leaf.path);
    const bool asks = leaf.app->get_option_no_throw("--yes") != nullptr;
    const bool can_be_tried = leaf.app->get_option_no_throw("--dry-run") != nullptr;
    EXPECT_TRUE(asks || can_be_tried) << leaf.path << " has neither --yes nor --dry-run";
  }
  EXPECT_THAT(paths, ::testing::IsSupersetOf(
                         {"mapp maps delete", "mapp maps tag", "mapp compact", "mapp restore", "mapp backup"}));
}

TEST(CommandsTest, EveryOptionSaysWhatItIsFor) {
  CommandLine line;
  for (const Leaf& leaf : LeavesOf(line)) {
    EXPECT_FALSE(leaf.app->get_description().empty()) << leaf.path;
    for (const CLI::Option* option : leaf.app->get_options()) {
      EXPECT_FALSE(option->get_description().empty()) << leaf.path << ' ' << option->get_name();
    }
  }
}

}  // namespace
}  // namespace mapp
