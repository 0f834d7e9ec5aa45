// Arguments of `mapp maps log`, `diff` and `tag`.

#include "cli/commands.h"
#include "cli/map_history.h"

#include <iostream>
#include <memory>
#include <unistd.h>

namespace mapp {

void AddMapHistory(CLI::App& maps, Command& chosen) {
  auto log = std::make_shared<MapsLogOptions>();
  CLI::App* log_command = maps.add_subcommand("log", "What a map's revisions were made for, newest first");
  AddServer(*log_command, log->server);
  AddJson(*log_command, log->json);
  log_command->add_option("name", log->name, "Name of the map")->required()->type_name("MAP");
  log_command->add_option("--limit", log->max_runs, "Lines to print; revisions of one cause and session share one")
      ->check(CLI::Range(1, 1'000'000))
      ->type_name("N")
      ->capture_default_str();
  log_command->footer("Example: mapp maps log garage --limit 50");
  log_command->callback([log, &chosen] { chosen = [log] { return RunMapsLog(*log, std::cout); }; });

  auto diff = std::make_shared<MapsDiffOptions>();
  CLI::App* diff_command =
      maps.add_subcommand("diff", "Frames and points that came, moved or went between two revisions, by session");
  AddServer(*diff_command, diff->server);
  AddJson(*diff_command, diff->json);
  diff_command->add_option("name", diff->name, "Name of the map")->required()->type_name("MAP");
  diff_command->add_option("from", diff->from, "Earlier revision or tag")->required()->type_name("REVISION");
  diff_command->add_option("to", diff->to, "Later revision or tag; now, when left out")->type_name("REVISION");
  diff_command->footer("Example: mapp maps diff garage spring 4711");
  diff_command->callback([diff, &chosen] { chosen = [diff] { return RunMapsDiff(*diff, std::cout); }; });

  auto tag = std::make_shared<MapsTagOptions>();
  CLI::App* tag_command = maps.add_subcommand("tag", "Give a revision a name, or list the names");
  AddServer(*tag_command, tag->server);
  AddJson(*tag_command, tag->json);
  tag_command->add_option("name", tag->name, "Name of the map")->required()->type_name("MAP");
  CLI::Option* tag_name =
      tag_command->add_option("tag", tag->tag, "The tag; list all, when left out")->type_name("TAG");
  CLI::Option* at = tag_command->add_option("--at", tag->at, "Revision or tag to name, instead of the present one")
                        ->type_name("REVISION")
                        ->needs(tag_name);
  tag_command->add_flag("--remove", tag->remove, "Take the tag away; the revision stays")
      ->needs(tag_name)
      ->excludes(at);
  tag_command->add_flag("--yes", tag->yes, "Do not ask before a tag is removed");
  tag_command->footer("Example: mapp maps tag garage before-repainting --at 4711");
  tag_command->callback([tag, &chosen] {
    tag->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [tag] { return RunMapsTag(*tag, std::cin, std::cout); };
  });
}

}  // namespace mapp
