#pragma once

#include "cli/map_image.h"
#include "eval/harness/choices.h"
#include "mapp/base/status.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <array>
#include <functional>
#include <optional>
#include <string>

namespace mapp {

/// What the chosen subcommand runs once all arguments are parsed.
using Command = std::function<Status()>;

/// The whole command line, parsed into `chosen`, which must outlive the parsing. `command_line`: as typed, for reports.
void AddCommands(CLI::App& app, const std::string& command_line, Command& chosen);

// Each adds a subcommand with its options to `app`; `chosen` must outlive the parsing, which sets it to what is to run.
void AddReplay(CLI::App& app, Command& chosen);
void AddMaps(CLI::App& app, Command& chosen);
void AddSessions(CLI::App& app, Command& chosen);
void AddExport(CLI::App& app, Command& chosen);
void AddRender(CLI::App& app, Command& chosen);
void AddChanges(CLI::App& app, Command& chosen);
void AddServerInfo(CLI::App& app, Command& chosen);
void AddBackup(CLI::App& app, Command& chosen);
void AddCompact(CLI::App& app, Command& chosen);
void AddRestore(CLI::App& app, Command& chosen);
void AddVerify(CLI::App& app, Command& chosen);
void AddRebuild(CLI::App& app, Command& chosen);
void AddSimulate(CLI::App& app, Command& chosen);
/// `command_line`: as typed, for the report.
void AddEval(CLI::App& app, const std::string& command_line, Command& chosen);

// Options that several subcommands have.
void AddServer(CLI::App& command, std::string& server);
void AddJson(CLI::App& command, bool& json);
void AddAt(CLI::App& command, std::string& at);
void AddImageSize(CLI::App& command, int least_width_px, int least_height_px, MapImageOptions& image);
/// `mapp maps log`, `diff` and `tag`.
void AddMapHistory(CLI::App& maps, Command& chosen);
/// `mapp maps export` and `import`.
void AddMapBundles(CLI::App& maps, Command& chosen);

/// An option whose value is one of `choices`; `set` gets it.
template <typename T, size_t N>
CLI::Option* AddChoiceFunction(CLI::App& command, const char* name, const std::function<void(T)>& set,
                               const std::array<Choice<T>, N>& choices, const std::string& help) {
  const auto check = [choices](const std::string& text) -> std::string {
    if (ValueOf(choices, text)) return {};
    return fmt::format("{} is not {}", text, OneOf(choices));
  };
  const auto set_by_name = [set, choices](const std::string& text) {
    if (const std::optional<T> value = ValueOf(choices, text)) set(*value);
  };
  return command.add_option_function<std::string>(name, set_by_name, help)
      ->check(CLI::Validator(check, ""))
      ->type_name("NAME");
}

/// An option whose value is one of `choices`. `value` must outlive the parsing.
template <typename T, size_t N>
void AddChoice(CLI::App& command, const char* name, T& value, const std::array<Choice<T>, N>& choices,
               const std::string& help) {
  AddChoiceFunction<T>(
      command, name, [&value](T chosen) { value = chosen; }, choices, help)
      ->default_str(NameOf(choices, value));
}

/// An option that takes only what is one of `choices`; all of them when it is left out. `value` must outlive the
/// parsing.
template <typename T, size_t N>
void AddFilter(CLI::App& command, const char* name, std::optional<T>& value, const std::array<Choice<T>, N>& choices,
               const std::string& help) {
  AddChoiceFunction<T>(
      command, name, [&value](T chosen) { value = chosen; }, choices, help);
}

}  // namespace mapp
