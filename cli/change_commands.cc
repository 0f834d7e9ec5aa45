// Arguments of `mapp changes`.

#include "cli/change_export.h"
#include "cli/change_image.h"
#include "cli/change_text.h"
#include "cli/changes.h"
#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/time_text.h"

#include <iostream>
#include <memory>
#include <optional>

namespace mapp {
namespace {

void AddMap(CLI::App& command, std::string& map_name) {
  command.add_option("--map", map_name, "Name of the map")->required()->type_name("MAP");
}

/// A moment in UTC; `unix_ns` must outlive the parsing.
void AddTime(CLI::App& command, const char* name, int64_t& unix_ns, const std::string& help) {
  const auto check = [](const std::string& text) { return std::string(ParseUnixTime(text).status().message()); };
  const auto set = [&unix_ns](const std::string& text) { unix_ns = ParseUnixTime(text).value_or(unix_ns); };
  command.add_option_function<std::string>(name, set, help)->check(CLI::Validator(check, ""))->type_name("TIME");
}

/// Also of what would be taken for a number by wrapping around.
std::string ComplaintOfChangeId(const std::string& text) {
  const bool is_number = !text.empty() && text != "0" && text.find_first_not_of("0123456789") == std::string::npos;
  return is_number ? std::string() : fmt::format("{} is no change: give its number, as mapp changes list has it", text);
}

/// `check`: what is wrong with a file's name.
void AddOutFile(CLI::App& command, std::string& file, Status (*check)(const std::string&), const std::string& help) {
  const auto complain = [check](const std::string& name) { return std::string(check(name).message()); };
  command.add_option("--out", file, help)->required()->check(CLI::Validator(complain, ""))->type_name("FILE");
}

void AddDetect(CLI::App& changes, Command& chosen) {
  auto options = std::make_shared<ChangesDetectOptions>();
  CLI::App* command = changes.add_subcommand("detect", "Look through a map's history for what changed in the world");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  AddMap(*command, options->order.map_name);
  AddTime(*command, "--from", options->order.from_unix_ns, "Only what sessions tell that were opened from then on");
  AddTime(*command, "--to", options->order.to_unix_ns, "Only what sessions tell that were opened until then");
  const auto check = [](const std::string& text) -> std::string {
    double confidence = 0;
    if (CLI::detail::lexical_cast(text, confidence) && confidence > 0 && confidence <= 1) return {};
    return fmt::format("{} is no confidence: give a number above 0, up to 1", text);
  };
  command
      ->add_option("--auto-accept", options->order.auto_accept,
                   "Accept at once what is proposed and at least this sure, above 0, up to 1")
      ->check(CLI::Validator(check, ""))
      ->type_name("CONFIDENCE");
  command->footer(
      "TIME in UTC: 2026-11-23T15:00:00Z, 2026-11-23 (its first moment), or Unix seconds.\n"
      "Ctrl-C ends it; what was read is kept. Afterwards: mapp changes render, accept, reject.\n"
      "Example: mapp changes detect --map garage\n"
      "Example: mapp changes detect --map garage --from 2026-11-01 --to 2026-11-23T15:00:00Z --auto-accept 0.95");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunChangesDetect(*options, watcher->token(), std::cout);
    };
  });
}

void AddListAndShow(CLI::App& changes, Command& chosen) {
  auto list = std::make_shared<ChangesListOptions>();
  CLI::App* list_command = changes.add_subcommand("list", "Changes that were found, by id");
  AddServer(*list_command, list->server);
  AddJson(*list_command, list->json);
  AddMap(*list_command, list->map_name);
  AddFilter(*list_command, "--status", list->status, kWorldChangeStatuses, "Only proposed, accepted or rejected ones");
  AddFilter(*list_command, "--kind", list->kind, kWorldChangeKinds, "Only what appeared, vanished or moved");
  list_command->footer("Example: mapp changes list --map garage --status proposed");
  list_command->callback([list, &chosen] { chosen = [list] { return RunChangesList(*list, std::cout); }; });

  auto show = std::make_shared<ChangesShowOptions>();
  CLI::App* show_command =
      changes.add_subcommand("show", "Everything of one change: boxes, times, sessions and points behind it");
  AddServer(*show_command, show->server);
  AddJson(*show_command, show->json);
  AddMap(*show_command, show->map_name);
  show_command->add_option("id", show->id, "Number of the change")
      ->required()
      ->check(CLI::Validator(ComplaintOfChangeId, ""))
      ->type_name("CHANGE");
  show_command->footer("Example: mapp changes show --map garage 12");
  show_command->callback([show, &chosen] { chosen = [show] { return RunChangesShow(*show, std::cout); }; });
}

void AddRenderAndExport(CLI::App& changes, Command& chosen) {
  auto render = std::make_shared<ChangesRenderOptions>();
  CLI::App* render_command =
      changes.add_subcommand("render", "Draw the changes in the map from above, or the world before and after them");
  AddServer(*render_command, render->server);
  AddJson(*render_command, render->json);
  AddMap(*render_command, render->map_name);
  AddOutFile(*render_command, render->out_file, CheckPngName, "The PNG, - for standard output");
  render_command->add_option("--change", render->change_id, "Only this one, from near, before and after")
      ->check(CLI::Validator(ComplaintOfChangeId, ""))
      ->type_name("CHANGE");
  render_command->add_flag("--before-after", render->before_after, "Two pictures side by side, around all changes");
  AddImageSize(*render_command, kLeastChangesWidthPx, kLeastChangesHeightPx, render->image);
  render_command->footer(
      "Vanished: red. Appeared: green. Moved: from orange to blue. Rejected changes are shown by --change alone.\n"
      "Example: mapp changes render --map garage --out changes.png\n"
      "Example: mapp changes render --map garage --out change-12.png --change 12");
  render_command->callback([render, &chosen] { chosen = [render] { return RunChangesRender(*render, std::cout); }; });

  auto save = std::make_shared<ChangesExportOptions>();
  CLI::App* export_command = changes.add_subcommand(
      "export", "Write the changes as GeoJSON-like features, or the map's points with the changed ones in color");
  AddServer(*export_command, save->server);
  AddJson(*export_command, save->json);
  AddMap(*export_command, save->map_name);
  const auto check = [](const std::string& file) { return ChangeExportFormatOf(file).status(); };
  AddOutFile(*export_command, save->out_file, check, ".json or .geojson: the features; .ply: the points");
  export_command->footer(
      "Coordinates are metres of the map, not degrees.\n"
      "Example: mapp changes export --map garage --out changes.geojson\n"
      "Example: mapp changes export --map garage --out changes.ply");
  export_command->callback([save, &chosen] { chosen = [save] { return RunChangesExport(*save, std::cout); }; });
}

void AddDecision(CLI::App& changes, ChangeDecision decision, const std::string& name, const std::string& help,
                 const std::string& footer, Command& chosen) {
  auto options = std::make_shared<ChangesDecideOptions>();
  options->decision = decision;
  CLI::App* command = changes.add_subcommand(name, help);
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  AddMap(*command, options->map_name);
  command->add_option("ids", options->ids, "Numbers of the changes: all of them or none")
      ->required()
      ->check(CLI::Validator(ComplaintOfChangeId, ""))
      ->type_name("CHANGE");
  command->footer(footer);
  command->callback([options, &chosen] { chosen = [options] { return RunChangesDecide(*options, std::cout); }; });
}

}  // namespace

void AddChanges(CLI::App& app, Command& chosen) {
  CLI::App* changes = app.add_subcommand("changes", "Find, show, draw, export, accept and reject changes of the world")
                          ->require_subcommand(1);
  AddDetect(*changes, chosen);
  AddListAndShow(*changes, chosen);
  AddRenderAndExport(*changes, chosen);
  AddDecision(*changes, ChangeDecision::kAccept, "accept",
              "Apply changes to the map: points of what vanished or moved away are retired, at one new revision",
              "mapp changes undo takes it back.\nExample: mapp changes accept --map garage 12 14", chosen);
  AddDecision(*changes, ChangeDecision::kReject, "reject",
              "Say that changes have not happened; they are not proposed again",
              "mapp changes undo takes it back.\nExample: mapp changes reject --map garage 13", chosen);
  AddDecision(*changes, ChangeDecision::kUndo, "undo",
              "Take acceptance or rejection back: proposed again, and retired points live again, at one new revision",
              "Example: mapp changes undo --map garage 12", chosen);
}

}  // namespace mapp
