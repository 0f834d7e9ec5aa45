#include "cli/commands.h"

namespace mapp {

void AddCommands(CLI::App& app, const std::string& command_line, Command& chosen) {
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done, 1 failed, 2 wrong usage. MAPP_SERVER names the server when --server does not.\n"
      "Each command's --help ends with an example.");
  AddReplay(app, chosen);
  AddMaps(app, chosen);
  AddSessions(app, chosen);
  AddExport(app, chosen);
  AddRender(app, chosen);
  AddChanges(app, chosen);
  AddServerInfo(app, chosen);
  AddBackup(app, chosen);
  AddRestore(app, chosen);
  AddCompact(app, chosen);
  AddVerify(app, chosen);
  AddRebuild(app, chosen);
  AddSimulate(app, chosen);
  AddEval(app, command_line, chosen);
}

}  // namespace mapp
