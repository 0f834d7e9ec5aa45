// Arguments of the commands that look after a server: maps, sessions, export, render, server-info.

#include "cli/commands.h"
#include "cli/export_map.h"
#include "cli/interrupt.h"
#include "cli/maps.h"
#include "cli/render.h"
#include "cli/server_info.h"
#include "cli/sessions.h"

#include <iostream>
#include <memory>
#include <unistd.h>

namespace mapp {

void AddServer(CLI::App& command, std::string& server) {
  command.add_option("--server", server, "Server, host:port")->envname("MAPP_SERVER")->default_val("127.0.0.1:7878");
}

void AddJson(CLI::App& command, bool& json) { command.add_flag("--json", json, "Print JSON instead of a table"); }

void AddAt(CLI::App& command, std::string& at) {
  command.add_option("--at", at, "As it was at this revision or tag, instead of now")->type_name("REVISION");
}

void AddImageSize(CLI::App& command, int least_width_px, int least_height_px, MapImageOptions& image) {
  const auto add = [&](const char* name, const char* what, int least_px, int& size_px) {
    command
        .add_option(name, size_px, fmt::format("{} of the picture, pixels, {} to {}", what, least_px, kLargestImagePx))
        ->check(CLI::Range(least_px, kLargestImagePx))
        ->capture_default_str();
  };
  add("--width", "Width", least_width_px, image.width_px);
  add("--height", "Height", least_height_px, image.height_px);
}

void AddMaps(CLI::App& app, Command& chosen) {
  CLI::App* maps =
      app.add_subcommand("maps",
                         "List, show, optimize and delete maps, look into their past, carry them to another server")
          ->require_subcommand(1);

  auto list = std::make_shared<MapsListOptions>();
  CLI::App* list_command = maps->add_subcommand("list", "All maps of a server");
  AddServer(*list_command, list->server);
  AddJson(*list_command, list->json);
  list_command->footer("Example: mapp maps list --server robots.local:7878");
  list_command->callback([list, &chosen] { chosen = [list] { return RunMapsList(*list, std::cout); }; });

  auto show = std::make_shared<MapsShowOptions>();
  CLI::App* show_command = maps->add_subcommand("show", "One map in detail");
  AddServer(*show_command, show->server);
  AddJson(*show_command, show->json);
  AddAt(*show_command, show->at);
  show_command->add_option("name", show->name, "Name of the map")->required()->type_name("MAP");
  show_command->footer("Example: mapp maps show garage --at before-repainting");
  show_command->callback([show, &chosen] { chosen = [show] { return RunMapsShow(*show, std::cout); }; });

  auto optimize = std::make_shared<MapsOptimizeOptions>();
  CLI::App* optimize_command = maps->add_subcommand("optimize", "Adjust all of a map together and fuse what is double");
  AddServer(*optimize_command, optimize->server);
  AddJson(*optimize_command, optimize->json);
  optimize_command->add_option("name", optimize->name, "Name of the map")->required()->type_name("MAP");
  optimize_command->footer("Ctrl-C ends it after the last finished round.\nExample: mapp maps optimize garage");
  optimize_command->callback([optimize, &chosen] {
    chosen = [optimize]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunMapsOptimize(*optimize, watcher->token(), std::cout);
    };
  });

  auto remove = std::make_shared<MapsDeleteOptions>();
  CLI::App* delete_command = maps->add_subcommand("delete", "Delete a map with everything in it");
  AddServer(*delete_command, remove->server);
  AddJson(*delete_command, remove->json);
  delete_command->add_flag("--yes", remove->yes, "Do not ask");
  delete_command->add_flag("--force", remove->force, "Also when sessions are open");
  delete_command->add_option("name", remove->name, "Name of the map")->required()->type_name("MAP");
  delete_command->footer("Example: mapp maps delete garage");
  delete_command->callback([remove, &chosen] {
    remove->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [remove] { return RunMapsDelete(*remove, std::cin, std::cout); };
  });

  AddMapHistory(*maps, chosen);
  AddMapBundles(*maps, chosen);
}

void AddSessions(CLI::App& app, Command& chosen) {
  CLI::App* sessions =
      app.add_subcommand("sessions", "List, show, revert, erase and release sessions")->require_subcommand(1);
  auto list = std::make_shared<SessionsListOptions>();
  CLI::App* command = sessions->add_subcommand("list", "Sessions, oldest first");
  AddServer(*command, list->server);
  AddJson(*command, list->json);
  command->add_option("--map", list->map_name, "Only of this map");
  command->footer("Example: mapp sessions list --map garage");
  command->callback([list, &chosen] { chosen = [list] { return RunSessionsList(*list, std::cout); }; });

  auto show = std::make_shared<SessionsShowOptions>();
  CLI::App* show_command = sessions->add_subcommand("show", "One session, and why it is quarantined if it is");
  AddServer(*show_command, show->server);
  AddJson(*show_command, show->json);
  show_command->add_option("id", show->id, "Number of the session")->required()->type_name("SESSION");
  show_command->footer("Example: mapp sessions show 17");
  show_command->callback([show, &chosen] { chosen = [show] { return RunSessionsShow(*show, std::cout); }; });

  auto revert = std::make_shared<SessionsRevertOptions>();
  CLI::App* revert_command =
      sessions->add_subcommand("revert", "Take a session's whole contribution out of its map; release brings it back");
  AddServer(*revert_command, revert->server);
  AddJson(*revert_command, revert->json);
  revert_command->add_option("--reason", revert->reason, "For other operators and the device")->type_name("TEXT");
  revert_command->add_flag("--dry-run", revert->dry_run, "Only say what would go");
  revert_command->add_flag("--yes", revert->yes, "Do not ask");
  revert_command->add_option("id", revert->id, "Number of the session")->required()->type_name("SESSION");
  revert_command->footer("Example: mapp sessions revert 7 --reason loose-camera --dry-run");
  revert_command->callback([revert, &chosen] {
    revert->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [revert] { return RunSessionsRevert(*revert, std::cin, std::cout); };
  });

  auto erase = std::make_shared<SessionsEraseOptions>();
  CLI::App* erase_command = sessions->add_subcommand(
      "erase", "Forget a session for good: what it sent and what was made of it; ends the map's readable past");
  AddServer(*erase_command, erase->server);
  AddJson(*erase_command, erase->json);
  erase_command->add_flag("--force", erase->force, "Also when it is open");
  erase_command->add_flag("--dry-run", erase->dry_run, "Only say what would go");
  erase_command->add_flag("--yes", erase->yes, "Do not ask");
  erase_command->add_option("id", erase->id, "Number of the session")->required()->type_name("SESSION");
  erase_command->footer("Example: mapp sessions erase 7 --dry-run");
  erase_command->callback([erase, &chosen] {
    erase->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [erase] { return RunSessionsErase(*erase, std::cin, std::cout); };
  });

  auto release = std::make_shared<SessionsReleaseOptions>();
  CLI::App* release_command = sessions->add_subcommand(
      "release", "Lift a quarantine or a reversion for good; what was left out enters the map");
  AddServer(*release_command, release->server);
  AddJson(*release_command, release->json);
  release_command->add_flag("--yes", release->yes, "Do not ask");
  release_command->add_option("id", release->id, "Number of the session")->required()->type_name("SESSION");
  release_command->footer("Example: mapp sessions release 17");
  release_command->callback([release, &chosen] {
    release->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [release] { return RunSessionsRelease(*release, std::cin, std::cout); };
  });
}

void AddExport(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* command = app.add_subcommand("export", "Write a map's points or trajectories to files");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->add_option("--map", options->map_name, "Map to export")->required();
  AddAt(*command, options->at);
  static constexpr std::array kFormats = {Choice<ExportFormat>{"ply", ExportFormat::kPly},
                                          Choice<ExportFormat>{"tum", ExportFormat::kTum}};
  AddChoice(*command, "--format", options->format, kFormats, "ply: the points; tum: each session's keyframes");
  command->add_flag_callback(
      "--ascii", [options] { options->encoding = PlyEncoding::kAscii; }, "PLY as text instead of binary");
  command->add_option("--out", options->out, "PLY: the file, - for standard output. TUM: a folder")
      ->required()
      ->type_name("PATH");
  command->footer(
      "All of a map for another server: mapp maps export.\n"
      "Example: mapp export --map garage --format ply --out garage.ply");
  command->callback([options, &chosen] { chosen = [options] { return RunExport(*options, std::cout); }; });
}

void AddRender(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* command = app.add_subcommand("render", "Draw a map from above");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->add_option("--map", options->map_name, "Map to draw")->required();
  AddAt(*command, options->at);
  command->add_option("--out", options->out_file, "The PNG")->required()->type_name("FILE");
  command->add_option("--frames", options->frame_files, "Frame logs that mapp replay wrote with --frames-out")
      ->type_name("FILE");
  AddImageSize(*command, kLeastMapWidthPx, kLeastMapHeightPx, options->image);
  command->footer("Example: mapp render --map garage --out garage.png --width 1600");
  command->callback([options, &chosen] { chosen = [options] { return RunRender(*options, std::cout); }; });
}

void AddServerInfo(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<ServerInfoOptions>();
  CLI::App* command = app.add_subcommand(
      "server-info", "Version of a server, what it has used, and how long its methods and steps take");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->footer("Example: mapp server-info --json");
  command->callback([options, &chosen] { chosen = [options] { return RunServerInfo(*options, std::cout); }; });
}

}  // namespace mapp
