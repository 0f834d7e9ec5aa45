#pragma once

#include "cli/replay_source.h"
#include "mapp/base/status.h"
#include "mapp/client/participant.h"

#include <chrono>
#include <optional>
#include <ostream>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

enum class ReplayRate {
  kMax,   ///< the next frame as soon as everything the last one caused is done, here and at the server: repeatable
  kReal,  ///< frames at their recorded times, as a device would see them
};

/// Ground truth and estimated trajectory of another session of the map, both TUM files.
struct TrajectoryFiles {
  std::string truth_file;
  std::string trajectory_file;
};

struct ReplayOptions {
  std::string server;
  std::string map_name;
  std::string device;
  std::string sequence;  ///< as OpenSequenceSource takes it
  ReplayLevel level = ReplayLevel::kImages;
  ParticipantOptions participation;  ///< policies and their settings; map and device are those above
  ReplayRate rate = ReplayRate::kMax;
  std::optional<TrajectoryFiles> align_by;     ///< the map's first session
  std::vector<TrajectoryFiles> together_with;  ///< sessions judged with this one under one alignment
  /// TUM, T_map_camera of the aligned fragments, else T_session_camera of the longest one as the file's first line
  /// says; empty: none.
  std::string trajectory_file;
  std::string truth_file;   ///< the sequence's ground truth as TUM, where it has one; empty: none
  std::string frames_file;  ///< frame log for `mapp render`, of the aligned fragments if any; empty: none
  std::string json_file;    ///< the report as JSON, `-` for standard output; empty: none
  /// How long one frame's consequences, or closing the session, may take.
  std::chrono::milliseconds patience{120'000};
};

/// `mapp replay`: plays a sequence through the built-in tracker, or its features through a device
/// without images, against a server, closes the session and reports.
/// A device that is lost for long goes on in a new fragment, which is a session of its own.
/// A stop request ends it after the frame under way: the session is closed, the report written, and the answer is
/// CANCELLED. So is a sequence that breaks off at a broken image, whose error is then the answer.
/// ABORTED: keyframes were refused by the server or found no room while it was away; the report counts them.
/// INVALID_ARGUMENT: a sensor the tracker cannot use, or files that do not parse.
Status RunReplay(const ReplayOptions& options, const std::stop_token& stop, std::ostream& out);
/// The same with what is played given, whatever `options.sequence` says.
Status RunReplay(const ReplayOptions& options, const ReplaySource& source, const std::stop_token& stop,
                 std::ostream& out);

}  // namespace mapp
