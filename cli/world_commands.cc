// Arguments of `mapp simulate` and `mapp eval`.

#include "cli/commands.h"
#include "cli/eval.h"
#include "cli/interrupt.h"
#include "cli/simulate.h"
#include "cli/visit_spec.h"
#include "eval/harness/choices.h"
#include "sim/world/camera_rig.h"
#include "sim/world/world.h"

#include <fmt/ranges.h>

#include <iostream>
#include <memory>
#include <string>
#include <vector>

namespace mapp {
namespace {

void AddSimulateRoom(CLI::App& simulate, Command& chosen) {
  auto options = std::make_shared<SimulateRoomOptions>();
  CLI::App* command = simulate.add_subcommand("room", "A session of a furnished room, as a TUM RGB-D folder");
  command->add_option("--out", options->folder, "Folder, made; must not hold anything")->required()->type_name("DIR");
  command->add_option("--session", options->room.session, "Which walk through the room")
      ->check(CLI::Range(0U, RoomSpec::kMaxSession))
      ->capture_default_str();
  command->add_option("--seed", options->room.seed, "Which room")->capture_default_str();
  AddJson(*command, options->json);
  command->footer("Example: mapp simulate room --session 1 --out room-1");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunSimulateRoom(*options, watcher->token(), std::cout);
    };
  });
}

void AddImageOptions(CLI::App& command, const std::shared_ptr<SimulateOptions>& options) {
  command.add_option_function<double>(
      "--noise", [options](double factor) { options->images.noise = ScaledNoise(factor); },
      "Noise of gray levels and depth: 0 none, 1 as real cameras (default 1)");
  command.add_option("--exposure", options->images.exposure, "Brightness factor, (0, 16]")->capture_default_str();
  command.add_option("--motion-blur", options->images.motion_blur, "Pictures averaged over an exposure, odd; 1: none")
      ->capture_default_str();
  command.add_option_function<double>(
      "--exposure-ms", [options](double exposure_ms) { options->images.exposure_s = exposure_ms / 1000; },
      "Exposure time for --motion-blur, [0, 100] (default: the camera's)");
  command.add_flag("--color", options->images.with_color, "Colour images of the left or colour camera");
}

void AddSimulateWorld(CLI::App& simulate, const std::string& setting, Command& chosen) {
  auto options = std::make_shared<SimulateOptions>();
  sim::SimulationOptions& world = options->simulation;
  world.setting = setting;
  CLI::App* command = simulate.add_subcommand(setting, fmt::format("Visits of users to the {}", setting));
  command->add_option("--out", options->folder, "Folder, made; must not hold anything")->required()->type_name("DIR");
  command->add_option("--users", world.num_users, "Who come one after the other")->capture_default_str();
  command->add_option("--path", world.path_m, "Length of each user's way, metres")->capture_default_str();
  command->add_option("--seed", world.seed, "Same seed, same bytes")->capture_default_str();
  command
      ->add_option("--camera", world.cameras, fmt::format("Dealt out in turn: {}", fmt::join(sim::CameraNames(), ", ")))
      ->delimiter(',')
      ->type_name("NAME,...");
  AddChoice(*command, "--sensor", world.sensor, kSensorChoices,
            "rgbd: TUM folders; stereo, mono, mono-inertial: EuRoC");
  command->add_option("--rate", world.rate_hz, "Images a second; 0: the camera's")->capture_default_str();
  command->add_option("--changes", world.num_changes, "Objects that leave, come or are moved between visits")
      ->capture_default_str();
  command
      ->add_option("--changes-near", world.change_reach_m,
                   "Only what is within so many metres of a user's way changes; 0: anything")
      ->capture_default_str();
  command
      ->add_option_function<std::vector<std::string>>(
          "--change-kinds",
          [&world](const std::vector<std::string>& names) {
            world.change_kinds.clear();
            for (const std::string& name : names) world.change_kinds.push_back(*ValueOf(kChangeKindChoices, name));
          },
          fmt::format("What may happen: {} (default: everything)", OneOf(kChangeKindChoices)))
      ->check(CLI::Validator(
          [](const std::string& name) {
            return ValueOf(kChangeKindChoices, name) ? std::string()
                                                     : fmt::format("{} is not {}", name, OneOf(kChangeKindChoices));
          },
          ""))
      ->delimiter(',')
      ->type_name("NAME,...");
  command->add_option("--stable", world.num_stable_visits, "Nothing changes before so many visits have ended")
      ->capture_default_str();
  command->add_option("--passers", world.num_passers, "People who walk about")->capture_default_str();
  command->add_option("--trajectory", world.trajectory_files, "TUM files, T_world_camera, flown in turn; no ways then")
      ->type_name("FILE");
  command->add_option("--max-duration", world.max_duration_s, "Seconds after which --trajectory is cut; 0: not")
      ->capture_default_str();
  command->add_option("--routes", world.num_routes, "So many ways that users walk again; 0: each has his own")
      ->capture_default_str();
  command->add_option("--textures", world.textures_folder, "Photographs that paper the walls")->type_name("DIR");
  AddImageOptions(*command, options);
  AddJson(*command, options->json);
  command->footer(fmt::format("Example: mapp simulate {0} --users 2 --path 60 --out {0}", setting));
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunSimulate(*options, watcher->token(), std::cout);
    };
  });
}

}  // namespace

void AddSimulate(CLI::App& app, Command& chosen) {
  CLI::App* simulate = app.add_subcommand("simulate", "Write sequences of a place with a known truth");
  simulate->require_subcommand(1);
  for (const std::string& setting : sim::SettingNames()) AddSimulateWorld(*simulate, setting, chosen);
  AddSimulateRoom(*simulate, chosen);
}

void AddEval(CLI::App& app, const std::string& command_line, Command& chosen) {
  auto options = std::make_shared<EvalOptions>();
  options->command = command_line;
  CLI::App* command =
      app.add_subcommand("eval", "Measure this system the way the paper does, against servers of its own");
  command->footer("Experiments:\n" + ListExperiments() +
                  "  all             every one of them\n"
                  "  report          write CSV, plots and REPORT.md of OUT anew from its results.json\n"
                  "Example: mapp eval all --quick --out report");
  command->add_option("experiment", options->experiments, "Experiments of those below, all, or report")
      ->required()
      ->type_name("EXPERIMENT");
  command
      ->add_option("--out", options->out,
                   "Folder of results.json, CSV, plots and REPORT.md; results there are added to")
      ->default_val("eval-out")
      ->type_name("DIR");
  command->add_flag("--quick", options->quick, "Small worlds and short ways: all in under 10 minutes on 2 cores");
  command->add_option("--seed", options->seed, "Of worlds, ways and noise")->capture_default_str();
  command
      ->add_option("--setting", options->settings,
                   "Measure in these settings only; experiments that need others are left out")
      ->check(CLI::IsMember(sim::SettingNames()))
      ->type_name("SETTING");
  command
      ->add_option("--flights", options->flights,
                   "True flights for the hall at full scale (TUM, T_world_camera); else made up")
      ->type_name("FILE");
  command
      ->add_option("--recorded", options->recorded,
                   "Recorded stereo sequence with ground truth, for adapter; without it, all leaves that out")
      ->type_name("FOLDER");
  AddJson(*command, options->json);
  command->add_flag("--keep-work", options->keep_work, "Keep databases, logs and reports of the runs in OUT/work, in place of an earlier run's");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      if (options->experiments == std::vector<std::string>{"report"})
        return RunEvalReport(*options, watcher->token(), std::cout);
      return RunEval(*options, watcher->token(), std::cout);
    };
  });
}

}  // namespace mapp
