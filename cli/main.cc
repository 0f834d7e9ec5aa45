// The `mapp` command line: parses arguments and dispatches; commands.h has the subcommands.

#include "cli/commands.h"

#include <iostream>
#include <string>
#include <vector>

namespace mapp {
namespace {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;
constexpr int kExitUsage = 2;

/// The message on one line, as scripts expect it.
void PrintError(std::string message) {
  while (!message.empty() && message.back() == '\n') message.pop_back();
  for (char& c : message) {
    if (c == '\n') c = ' ';
  }
  std::cerr << "mapp: " << message << '\n';
}

/// CLI11 misses what is required before it looks at what it did not understand; people look for the latter first.
std::string UsageError(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<std::string> not_understood = app.remaining(/*recurse=*/true);
  if (not_understood.empty()) return error.what();
  return fmt::format("unknown command or option: {}", not_understood.front());
}

/// The command as typed, by the program's name.
std::string JoinArguments(int argc, char** argv) {
  std::string line = "mapp";
  for (int i = 1; i < argc; ++i) line += fmt::format(" {}", argv[i]);
  return line;
}

int Main(int argc, char** argv) {
  CLI::App app("Command line of Map++, a self-hosted service for shared visual maps", "mapp");
  app.set_version_flag("--version", MAPP_VERSION);
  Command chosen;
  AddCommands(app, JoinArguments(argc, argv), chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return app.exit(success);  // prints the help or the version
  } catch (const CLI::ParseError& error) {
    PrintError(UsageError(app, error) + " (see mapp --help)");
    return kExitUsage;
  }
  const Status status = chosen();
  if (status.ok()) return kExitDone;
  PrintError(std::string(status.message()));
  return kExitFailed;
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) { return mapp::Main(argc, argv); }
