// Arguments of `mapp maps export` and `import`.

#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/maps_bundle.h"

#include <iostream>
#include <memory>

namespace mapp {

void AddMapBundles(CLI::App& maps, Command& chosen) {
  auto options = std::make_shared<MapsExportOptions>();
  CLI::App* command = maps.add_subcommand("export", "Write all of a map to one file, which another server reads");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  AddAt(*command, options->at);
  command->add_option("name", options->name, "Name of the map")->required()->type_name("MAP");
  command->add_option("--bundle", options->bundle, "The file; it is there whole or not at all")
      ->required()
      ->type_name("FILE");
  command->add_flag("--force", options->force, "Replace a file that is there");
  command->footer(
      "Points and trajectories for other programs: mapp export.\n"
      "Example: mapp maps export garage --bundle garage.mappbundle");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunMapsExport(*options, watcher->token(), std::cout);
    };
  });

  auto import = std::make_shared<MapsImportOptions>();
  CLI::App* import_command = maps.add_subcommand("import", "Make a map of a file that mapp maps export has written");
  AddServer(*import_command, import->server);
  AddJson(*import_command, import->json);
  import_command->add_option("--bundle", import->bundle, "The file")->required()->type_name("FILE");
  import_command->add_option("--as", import->as, "Name of the new map, instead of the one it had")->type_name("MAP");
  import_command->add_flag("--dry-run", import->dry_run,
                           "Only check the file and say what would be imported; no server is asked");
  import_command->footer("Example: mapp maps import --bundle garage.mappbundle --as garage-2 --dry-run");
  import_command->callback([import, &chosen] {
    chosen = [import]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunMapsImport(*import, watcher->token(), std::cout);
    };
  });
}

}  // namespace mapp
