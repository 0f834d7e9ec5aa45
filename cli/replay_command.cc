// Arguments of `mapp replay`.

#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/replay.h"
#include "cli/sequence_source.h"
#include "eval/harness/choices.h"

#include <chrono>
#include <cmath>
#include <iostream>
#include <memory>
#include <string>
#include <utility>

namespace mapp {
namespace {

/// Refuses `sim:` names that stand for nothing, before anything is opened.
std::string CheckSequence(const std::string& name) { return std::string(CheckSequenceName(name).message()); }

/// Says what is wrong with the text of a budget; empty: nothing.
std::string CheckBudget(const std::string& text) {
  constexpr uint64_t kLeast = 65536;
  uint64_t bytes = 0;
  if (!CLI::detail::lexical_cast(text, bytes)) return text + ": must be a number of bytes";
  return bytes == 0 || bytes >= kLeast ? "" : text + ": must be 0 or at least 65536";
}

constexpr const char* kReplayFooter =
    R"(SEQUENCE is a folder (TUM RGB-D or EuRoC ASL layout), or drawn while it plays:
  sim:room/SESSION, sim:room:SEED/SESSION           the rendered room
  sim:SETTING/USER, sim:SETTING:KEY=VALUE,.../USER  a visit of mapp simulate SETTING,
      its long options being the keys: sim:garage:users=5,path=60,sensor=stereo/0;
      several names are joined by +: changes=4,change-kinds=appeared+moved

Figures, as in the JSON:
  keyframe_equivalents    frames on a shared map, where no keyframe is made, at which
                          the device would have made one mapping for itself
  ..._bytes_per_keyframe  over keyframes + keyframe_equivalents
  full_bytes              what --policy upload_all would have sent at each of these
  upload_bytes            keyframes, update reports and evidence, retries included
  full_features, _points  features of these keyframes, and those with a map point
  query_bytes             the largest overlap query
  freshness               1 - overlap_mean
  traffic                 messages and bytes by kind
  latency_ms              of each step; tracking on the own map, localization on the
                          shared one
  cpu_s                   device = process - reading, the drawing of rendered frames
                          being part of reading; extraction, of features from images, is
                          part of tracking and localization
  cached_tiles            of shared maps, taken from --tile-cache
  aligned_at_keyframe     0 for the session that founds the map, null if never
  fragments               a device that is lost for long begins a new session, unaligned
                          at first; the figures are of all of them together
  frames_aligned          tracked frames that have a pose in the map in the end
  ate_m                   RMSE of positions after the best rigid alignment, metres,
                          of the aligned frames, else of the longest fragment
  ate_scale               metres a unit of the session or map: a single camera does
                          not tell scale; until a map of metres gives it one, errors
                          are after the best similarity
  ate_joint_m             the same under the alignment of the map's first session,
                          as --align-by gives it: judges the merged map
  max_joint_error_m       of the frame that is the furthest off there
  ate_together_m          of this session and those of --together-with, under one
                          alignment for all of them
  ate_uncorrected_m, ate_joint_uncorrected_m
                          the same without what the server has corrected since the
                          keyframes were sent: as the device knew its way

Example: mapp replay --map garage --device car sim:garage:users=2,path=60/0)";

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
  AddChoice(
      command, "--evidence", options.report_evidence, kSwitchChoices,
      "off: on a shared map, do not tell which of its points were seen where they should be and which were missed");
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
  command
      .add_option("--look-ahead", options.look_ahead_m,
                  "How far ahead of the view a shared map reaches, straight on and where earlier sessions went on from "
                  "here, 0 to 100; 0: no farther than the view")
      ->check(CLI::Range(0.0, 100.0))
      ->type_name("METERS")
      ->capture_default_str();
  command
      .add_option("--shared-map-budget", options.max_shared_map_bytes,
                  "Tiles that one shared map may bring, nearest first; 0: no limit, else at least 65536")
      ->check(CLI::Validator(CheckBudget, ""))
      ->type_name("BYTES")
      ->capture_default_str();
}

void AddTileCache(CLI::App& command, TileCacheOptions& options) {
  command
      .add_option(
          "--tile-cache", options.folder,
          "Folder that keeps received tiles beyond the session, made when it is not there; devices may share it")
      ->type_name("FOLDER");
  // The bounds are those of ParticipantOptions::Validate, in MB of 2^20 bytes.
  auto megabytes = std::make_shared<uint64_t>(options.max_bytes >> 20);
  command.add_option("--tile-cache-mb", *megabytes, "Its size at most; tiles used least lately go first")
      ->check(CLI::Range(uint64_t{1}, uint64_t{1} << 30))
      ->type_name("MB")
      ->capture_default_str()
      ->each([megabytes, &options](const std::string& text) { options.max_bytes = std::stoull(text) << 20; });
}

}  // namespace

void AddReplay(CLI::App& app, Command& chosen) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* command = app.add_subcommand("replay", "Play a recorded or rendered sequence against a server");
  command->footer(kReplayFooter);
  AddServer(*command, options->server);
  command->add_option("--map", options->map_name, "Map to join; made when absent")->required();
  command->add_option("--device", options->device, "Name of the device, for operators")->required();
  AddPolicies(*command, options->participation);
  AddTileCache(*command, options->participation.tile_cache);
  AddChoice(*command, "--rate", options->rate, kRateChoices,
            "max: as fast as it goes, repeatable; real: at the recorded times");
  AddChoice(*command, "--level", options->level, kLevelChoices,
            "images, through the built-in tracker; features: of sim: sequences, without drawing them, far faster");
  auto align_by = std::make_shared<std::vector<std::string>>();
  command->add_option("--align-by", *align_by, "TUM files of the map's first session: truth, then trajectory")
      ->expected(2)
      ->type_name("TRUTH_0 TRAJECTORY_0");
  auto together = std::make_shared<std::vector<std::pair<std::string, std::string>>>();
  command
      ->add_option("--together-with", *together,
                   "TUM files of another session of the map, truth, then trajectory: for ate_together_m; repeatable")
      ->allow_extra_args(false)
      ->type_name("TRUTH TRAJECTORY");
  command
      ->add_option(
          "--trajectory-out", options->trajectory_file,
          "TUM: T_map_camera, where the map has the keyframes after the session; T_session_camera if never aligned")
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
  command->callback([options, align_by, together, patience_s, &chosen] {
    for (const auto& [truth, trajectory] : *together) options->together_with.push_back({truth, trajectory});
    if (!align_by->empty()) options->align_by = TrajectoryFiles{align_by->at(0), align_by->at(1)};
    options->patience = std::chrono::milliseconds(std::llround(1e3 * *patience_s));
    chosen = [options]() -> Status {
      MAPP_ASSIGN_OR_RETURN(const auto watcher, InterruptWatcher::Create());
      return RunReplay(*options, watcher->token(), std::cout);
    };
  });
}

}  // namespace mapp
