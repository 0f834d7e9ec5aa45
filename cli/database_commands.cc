// Arguments of the commands that look after the database file: backup, compact, rebuild, restore, verify.

#include "cli/backup.h"
#include "cli/commands.h"
#include "cli/compact.h"
#include "cli/interrupt.h"
#include "cli/rebuild.h"
#include "cli/verify.h"

#include <iostream>
#include <memory>
#include <unistd.h>

namespace mapp {

void AddBackup(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<BackupCommandOptions>();
  CLI::App* command = app.add_subcommand("backup", "Copy a database to a file while others write it");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->add_option("--db", options->database, "Copy this file from here instead of asking the server to")
      ->type_name("FILE");
  command
      ->add_option(
          "--to", options->to,
          "File to write, or a folder: NAME-YYYYmmddTHHMMSSZ.db in it. A server writes on its own machine, into "
          "its --backup-dir")
      ->required()
      ->type_name("PATH");
  command->add_option("--keep", options->num_kept, "In the folder, delete older backups than this many of NAME")
      ->check(CLI::Range(1, 1'000'000))
      ->type_name("N");
  command->add_flag("--dry-run", options->dry_run, "Only say what would be written, and what deleted");
  command->footer("Example: mapp backup --db /var/lib/mapp/maps.db --to /var/backups/mapp --keep 14");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunBackup(*options, watcher->token(), std::cout);
    };
  });
}

void AddCompact(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<CompactOptions>();
  CLI::App* command = app.add_subcommand(
      "compact", "Drop the history of revisions that need not be read any more; give back the space");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->add_option("--map", options->map_name, "Only this map's, instead of all");
  command->add_option("--keep-revisions", options->keep_revisions, "Keep so many revisions before the present one")
      ->type_name("N");
  command->add_flag("--rewrite", options->rewrite,
                    "Write the whole file anew afterwards: no trace of what was deleted, page checksums also for a "
                    "database of before there were any; uploads wait");
  command->add_option("--keep-days", options->keep_days, "Keep the state of so many days ago, and all since")
      ->check(CLI::Range(0.0, 36500.0))
      ->type_name("DAYS");
  command->add_flag("--yes", options->yes, "Do not ask");
  command->add_flag("--dry-run", options->dry_run, "Only say what would be dropped");
  command->footer(
      "Tagged revisions (mapp maps tag) stay, and all after them. With both --keep options, whatever one of them needs "
      "stays.\nExample: mapp compact --keep-days 30 --dry-run");
  command->callback([options, &chosen] {
    options->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunCompact(*options, watcher->token(), std::cin, std::cout);
    };
  });
}

void AddRestore(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<RestoreCommandOptions>();
  CLI::App* command = app.add_subcommand("restore", "Put a backup in a database's place; no server may run on it");
  AddJson(*command, options->json);
  command->add_option("backup", options->backup, "The backup")->required()->type_name("BACKUP");
  command->add_option("--db", options->database, "Database to restore; one that is there is kept beside it")
      ->required()
      ->type_name("FILE");
  command->add_flag("--yes", options->yes, "Do not ask");
  command->add_flag("--dry-run", options->dry_run, "Check the backup and say what would be done");
  command->footer(
      "Example: mapp restore /var/backups/mapp/maps-20260131T020000Z.db --db /var/lib/mapp/maps.db --dry-run");
  command->callback([options, &chosen] {
    options->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunRestore(*options, watcher->token(), std::cin, std::cout);
    };
  });
}

void AddVerify(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<VerifyCommandOptions>();
  CLI::App* command = app.add_subcommand("verify", "Look for all that is wrong with a database; changes nothing");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command
      ->add_option(
          "--db", options->database,
          "Look through this file from here, whether or not a server runs on it, instead of asking a server to")
      ->type_name("FILE");
  command->footer(
      "Exit code 1 when anything is wrong, one line each.\nExample: mapp verify --db /var/lib/mapp/maps.db");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunVerify(*options, watcher->token(), std::cout);
    };
  });
}

void AddRebuild(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<RebuildCommandOptions>();
  CLI::App* command =
      app.add_subcommand("rebuild", "Make all that is derived again from a database's keyframe log, in a new file");
  AddJson(*command, options->json);
  command->add_option("--db", options->database, "Database whose keyframe log is read; it is not changed")
      ->required()
      ->type_name("FILE");
  command->add_option("--to", options->to, "The new database")->required()->type_name("FILE");
  command
      ->add_option("--threads", options->num_threads,
                   "Of the optimizations; with one, the same log gives the same map, bit for bit")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->footer(
      "Stop the server first, or what it acknowledges meanwhile is missed. `mapp restore` puts the new file in place.\n"
      "Example: mapp rebuild --db /var/lib/mapp/maps.db --to /var/lib/mapp/rebuilt.db");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunRebuild(*options, watcher->token(), std::cout);
    };
  });
}

}  // namespace mapp
