// The `mapp` command line: parses arguments and dispatches; each subcommand has a file of its own.

#include "cli/eval.h"
#include "cli/export_map.h"
#include "cli/interrupt.h"
#include "cli/maps.h"
#include "cli/render.h"
#include "cli/replay.h"
#include "cli/sequence_source.h"
#include "cli/server_info.h"
#include "cli/sessions.h"
#include "cli/simulate.h"
#include "cli/visit_spec.h"
#include "eval/harness/choices.h"
#include "sim/world/camera_rig.h"
#include "sim/world/world.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <iostream>
#include <memory>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;
constexpr int kExitUsage = 2;

/// What the chosen subcommand runs once all arguments are parsed.
using Command = std::function<Status()>;

/// The message on one line, as scripts expect it.
void PrintError(std::string message) {
  while (!message.empty() && message.back() == '\n') message.pop_back();
  for (char& c : message) {
    if (c == '\n') c = ' ';
  }
  std::cerr << "mapp: " << message << '\n';
}

void AddServer(CLI::App& command, std::string& server) {
  command.add_option("--server", server, "Server, host:port")->envname("MAPP_SERVER")->default_val("127.0.0.1:7878");
}

void AddJson(CLI::App& command, bool& json) { command.add_flag("--json", json, "Print JSON instead of a table"); }

/// An option whose value is one of `choices`. `value` must outlive the parsing.
template <typename T, size_t N>
void AddChoice(CLI::App& command, const char* name, T& value, const std::array<Choice<T>, N>& choices,
               const std::string& help) {
  const auto check = [choices](const std::string& text) -> std::string {
    if (ValueOf(choices, text)) return {};
    return fmt::format("{} is not {}", text, OneOf(choices));
  };
  const auto set = [&value, choices](const std::string& text) { value = ValueOf(choices, text).value_or(value); };
  command.add_option_function<std::string>(name, set, help)
      ->check(CLI::Validator(check, ""))
      ->type_name("NAME")
      ->default_str(NameOf(choices, value));
}

/// Refuses `sim:` names that stand for nothing, before anything is opened.
std::string CheckSequence(const std::string& name) { return std::string(CheckSequenceName(name).message()); }

constexpr const char* kReplayFooter =
    R"(SEQUENCE is a folder (TUM RGB-D or EuRoC ASL layout), or drawn while it plays:
  sim:room/SESSION, sim:room:SEED/SESSION           the rendered room
  sim:SETTING/USER, sim:SETTING:KEY=VALUE,.../USER  a visit of mapp simulate SETTING,
      its long options being the keys: sim:garage:users=5,path=60,sensor=stereo/0

Figures, as in the JSON:
  keyframe_equivalents    frames on a shared map, where no keyframe is made, at which
                          the device would have made one mapping for itself
  ..._bytes_per_keyframe  over keyframes + keyframe_equivalents
  full_bytes              what --policy upload_all would have sent at each of these
  upload_bytes            keyframes and update reports, retries included
  full_features, _points  features of these keyframes, and those with a map point
  query_bytes             the largest overlap query
  freshness               1 - overlap_mean
  traffic                 messages and bytes by kind
  latency_ms              of each step; tracking on the own map, localization on the
                          shared one
  cpu_s                   device = process - reading, the drawing of rendered frames
                          being part of reading
  aligned_at_keyframe     0 for the session that founds the map, null if never
  fragments               a device that is lost for long begins a new session, unaligned
                          at first; the figures are of all of them together
  frames_aligned          tracked frames that have a pose in the map in the end
  ate_m                   RMSE of positions after the best rigid alignment, metres,
                          of the aligned frames, else of the longest fragment
  ate_scale               metres a unit of the session: a single camera does not tell
                          scale, and its ate_m is after the best similarity
  ate_joint_m             the same under the alignment of the map's first session,
                          as --align-by gives it: judges the merged map)";

constexpr std::array kRateChoices = {Choice<ReplayRate>{"max", ReplayRate::kMax},
                                     Choice<ReplayRate>{"real", ReplayRate::kReal}};

constexpr std::array kLevelChoices = {Choice<ReplayLevel>{"images", ReplayLevel::kImages},
                                      Choice<ReplayLevel>{"features", ReplayLevel::kFeatures}};

void AddPolicies(CLI::App& command, ParticipantOptions& options) {
  AddChoice(command, "--policy", options.policy, kPolicyChoices,
            "map: upload what is fresh; upload_all: every keyframe whole");
  AddChoice(command, "--sampler", options.sampler, kSamplerChoices,
            "How the overlap with the map is assessed: depth_sketch, samples at the depths the device sees; uniform, "
            "evenly through the view cone; occupancy, no samples but the bins of the view that hold points");
  AddChoice(command, "--injection", options.injection, kInjectionChoices,
            "Redundant points that are uploaded all the same: often, those observed more often than the average; "
            "random, as many at random; none");
  AddChoice(command, "--sharing", options.sharing, kSwitchChoices,
            "off: where the map is known, neither take it nor upload, and go on mapping for oneself");
  command
      .add_option("--min-seen-by-others", options.min_seen_by_others,
                  "Share of the map points in view that other sessions must have seen for a shared map to be taken, 0 "
                  "to 1; where fewer, the device's own map is the better one")
      ->check(CLI::Range(0.0, 1.0))
      ->type_name("SHARE")
      ->capture_default_str();
  command.add_option("--alpha", options.oversharing, "Oversharing: width of the shared view over the camera's, 1 to 4")
      ->check(CLI::Range(1.0, 4.0))
      ->type_name("FACTOR")
      ->capture_default_str();
}

void AddReplay(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* command = app.add_subcommand("replay", "Play a recorded or rendered sequence against a server");
  command->footer(kReplayFooter);
  AddServer(*command, options->server);
  command->add_option("--map", options->map_name, "Map to join; made when absent")->required();
  command->add_option("--device", options->device, "Name of the device, for operators")->required();
  AddPolicies(*command, options->participation);
  AddChoice(*command, "--rate", options->rate, kRateChoices,
            "max: as fast as it goes, repeatable; real: at the recorded times");
  AddChoice(*command, "--level", options->level, kLevelChoices,
            "images, through the built-in tracker; features: of sim: sequences, without drawing them, far faster");
  auto align_by = std::make_shared<std::vector<std::string>>();
  command->add_option("--align-by", *align_by, "TUM files of the map's first session: truth, then trajectory")
      ->expected(2)
      ->type_name("TRUTH_0 TRAJECTORY_0");
  command->add_option("--trajectory-out", options->trajectory_file, "TUM: T_map_camera once aligned")
      ->type_name("FILE");
  command->add_option("--truth-out", options->truth_file, "TUM: the sequence's ground truth, where it has one")
      ->type_name("FILE");
  command->add_option("--frames-out", options->frames_file, "CSV of the frames in the map, for mapp render --frames")
      ->type_name("FILE");
  command->add_option("--json", options->json_file, "The report as JSON; - for standard output")->type_name("FILE");
  auto patience_s = std::make_shared<double>(std::chrono::duration<double>(options->patience).count());
  command
      ->add_option("--patience", *patience_s,
                   "How long one frame's consequences may take, and the map's optimisation at the end")
      ->check(CLI::Range(1.0, 86'400.0))
      ->type_name("SECONDS")
      ->capture_default_str();
  command->add_option("sequence", options->sequence, "What to play")
      ->required()
      ->type_name("SEQUENCE")
      ->check(CLI::Validator(CheckSequence, ""));
  command->callback([options, align_by, patience_s, &chosen] {
    if (!align_by->empty()) options->align_by = AlignBy{align_by->at(0), align_by->at(1)};
    options->patience = std::chrono::milliseconds(std::llround(1e3 * *patience_s));
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunReplay(*options, watcher->token(), std::cout);
    };
  });
}

void AddMaps(CLI::App& app, Command& chosen) {
  CLI::App* maps = app.add_subcommand("maps", "List, show, optimize and delete maps")->require_subcommand(1);

  auto list = std::make_shared<MapsListOptions>();
  CLI::App* list_command = maps->add_subcommand("list", "All maps of a server");
  AddServer(*list_command, list->server);
  AddJson(*list_command, list->json);
  list_command->callback([list, &chosen] { chosen = [list] { return RunMapsList(*list, std::cout); }; });

  auto show = std::make_shared<MapsShowOptions>();
  CLI::App* show_command = maps->add_subcommand("show", "One map in detail");
  AddServer(*show_command, show->server);
  AddJson(*show_command, show->json);
  show_command->add_option("name", show->name, "Name of the map")->required()->type_name("MAP");
  show_command->callback([show, &chosen] { chosen = [show] { return RunMapsShow(*show, std::cout); }; });

  auto optimize = std::make_shared<MapsOptimizeOptions>();
  CLI::App* optimize_command = maps->add_subcommand("optimize", "Adjust all of a map together and fuse what is double");
  AddServer(*optimize_command, optimize->server);
  AddJson(*optimize_command, optimize->json);
  optimize_command->add_option("name", optimize->name, "Name of the map")->required()->type_name("MAP");
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
  delete_command->callback([remove, &chosen] {
    remove->interactive = isatty(STDIN_FILENO) == 1;
    chosen = [remove] { return RunMapsDelete(*remove, std::cin, std::cout); };
  });
}

void AddSessions(CLI::App& app, Command& chosen) {
  CLI::App* sessions = app.add_subcommand("sessions", "List, show and release sessions")->require_subcommand(1);
  auto list = std::make_shared<SessionsListOptions>();
  CLI::App* command = sessions->add_subcommand("list", "Sessions, oldest first");
  AddServer(*command, list->server);
  AddJson(*command, list->json);
  command->add_option("--map", list->map_name, "Only of this map");
  command->callback([list, &chosen] { chosen = [list] { return RunSessionsList(*list, std::cout); }; });

  auto show = std::make_shared<SessionsShowOptions>();
  CLI::App* show_command = sessions->add_subcommand("show", "One session, and why it is quarantined if it is");
  AddServer(*show_command, show->server);
  AddJson(*show_command, show->json);
  show_command->add_option("id", show->id, "Number of the session")->required()->type_name("SESSION");
  show_command->callback([show, &chosen] { chosen = [show] { return RunSessionsShow(*show, std::cout); }; });

  auto release = std::make_shared<SessionsReleaseOptions>();
  CLI::App* release_command =
      sessions->add_subcommand("release", "Lift a session's quarantine for good; what was left out enters the map");
  AddServer(*release_command, release->server);
  AddJson(*release_command, release->json);
  release_command->add_flag("--yes", release->yes, "Do not ask");
  release_command->add_option("id", release->id, "Number of the session")->required()->type_name("SESSION");
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
  static constexpr std::array kFormats = {Choice<ExportFormat>{"ply", ExportFormat::kPly},
                                          Choice<ExportFormat>{"tum", ExportFormat::kTum}};
  AddChoice(*command, "--format", options->format, kFormats, "ply: the points; tum: each session's keyframes");
  command->add_flag_callback(
      "--ascii", [options] { options->encoding = PlyEncoding::kAscii; }, "PLY as text instead of binary");
  command->add_option("--out", options->out, "PLY: the file, - for standard output. TUM: a folder")
      ->required()
      ->type_name("PATH");
  command->callback([options, &chosen] { chosen = [options] { return RunExport(*options, std::cout); }; });
}

void AddRender(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<RenderOptions>();
  CLI::App* command = app.add_subcommand("render", "Draw a map from above");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->add_option("--map", options->map_name, "Map to draw")->required();
  command->add_option("--out", options->out_file, "The PNG")->required()->type_name("FILE");
  command->add_option("--frames", options->frame_files, "Frame logs that mapp replay wrote with --frames-out")
      ->type_name("FILE");
  command->add_option("--width", options->image.width_px, "Width of the picture, pixels, 400 to 16384")
      ->check(CLI::Range(400, 16384))
      ->capture_default_str();
  command->add_option("--height", options->image.height_px, "Height of the picture, pixels, 300 to 16384")
      ->check(CLI::Range(300, 16384))
      ->capture_default_str();
  command->callback([options, &chosen] { chosen = [options] { return RunRender(*options, std::cout); }; });
}

void AddServerInfo(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<ServerInfoOptions>();
  CLI::App* command = app.add_subcommand(
      "server-info", "Version of a server, what it has used, and how long its methods and steps take");
  AddServer(*command, options->server);
  AddJson(*command, options->json);
  command->callback([options, &chosen] { chosen = [options] { return RunServerInfo(*options, std::cout); }; });
}

void AddSimulateRoom(CLI::App& simulate, Command& chosen) {
  auto options = std::make_shared<SimulateRoomOptions>();
  CLI::App* command = simulate.add_subcommand("room", "A session of a furnished room, as a TUM RGB-D folder");
  command->add_option("--out", options->folder, "Folder, made; must not hold anything")->required()->type_name("DIR");
  command->add_option("--session", options->room.session, "Which walk through the room")
      ->check(CLI::Range(0U, RoomSpec::kMaxSession))
      ->capture_default_str();
  command->add_option("--seed", options->room.seed, "Which room")->capture_default_str();
  AddJson(*command, options->json);
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
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunSimulate(*options, watcher->token(), std::cout);
    };
  });
}

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
                  "  report          write CSV, plots and REPORT.md of OUT anew from its results.json");
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
  command->add_flag("--keep-work", options->keep_work, "Keep databases, logs and reports of the runs in OUT/work");
  command->callback([options, &chosen] {
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      if (options->experiments == std::vector<std::string>{"report"})
        return RunEvalReport(options->out, watcher->token(), std::cout);
      return RunEval(*options, watcher->token(), std::cout);
    };
  });
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
  app.require_subcommand(1);
  app.set_version_flag("--version", MAPP_VERSION);
  app.footer("Exit codes: 0 done, 1 failed, 2 wrong usage. MAPP_SERVER names the server when --server does not.");
  Command chosen;
  AddReplay(app, chosen);
  AddMaps(app, chosen);
  AddSessions(app, chosen);
  AddExport(app, chosen);
  AddRender(app, chosen);
  AddServerInfo(app, chosen);
  AddSimulate(app, chosen);
  AddEval(app, JoinArguments(argc, argv), chosen);
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
