#pragma once

#include "eval/harness/lab.h"
#include "eval/harness/results.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

enum class Scale {
  kQuick,  ///< small worlds and short ways: minutes for all experiments
  kFull,   ///< the paper's sizes
};

/// What an experiment has to work with.
struct EvalContext {
  Lab& lab;
  Scale scale = Scale::kQuick;
  uint64_t seed = 1;
  /// True flights for the hall (TUM, T_world_camera); empty: flights are made up.
  std::vector<std::string> flights;
  /// Settings to measure in; empty: all.
  std::vector<std::string> settings;
  /// Folder of a recorded sequence with ground truth; empty: none was given.
  std::string recorded;

  bool quick() const { return scale == Scale::kQuick; }
  /// Those of an experiment's settings that are to be measured in.
  std::vector<std::string> Chosen(const std::vector<std::string>& of) const;
};

/// One of the paper's results, measured on this system.
struct Experiment {
  std::string name;
  std::string title;
  std::vector<std::string> settings;  ///< that it measures in; at full scale perhaps more than at the quick one
  StatusOr<ExperimentResult> (*run)(EvalContext& context);
  /// Plays EvalContext::recorded.
  bool needs_recording = false;
};

/// In the order of the paper.
const std::vector<Experiment>& Experiments();

// One function a result of the paper; each fills tables, setup and remarks. Errors are the lab's.
StatusOr<ExperimentResult> RunTraffic(EvalContext& context);
StatusOr<ExperimentResult> RunOverhead(EvalContext& context);
StatusOr<ExperimentResult> RunHall(EvalContext& context);
StatusOr<ExperimentResult> RunServerLoad(EvalContext& context);
StatusOr<ExperimentResult> RunBandwidth(EvalContext& context);
StatusOr<ExperimentResult> RunLink(EvalContext& context);
StatusOr<ExperimentResult> RunLatency(EvalContext& context);
StatusOr<ExperimentResult> RunTrajectoryError(EvalContext& context);
StatusOr<ExperimentResult> RunLookAlikes(EvalContext& context);
StatusOr<ExperimentResult> RunRenderedLookAlikes(EvalContext& context);
StatusOr<ExperimentResult> RunReconstruction(EvalContext& context);
StatusOr<ExperimentResult> RunInjection(EvalContext& context);
StatusOr<ExperimentResult> RunSharing(EvalContext& context);
StatusOr<ExperimentResult> RunAlpha(EvalContext& context);
StatusOr<ExperimentResult> RunOverlap(EvalContext& context);
/// Not in the paper: what DetectChanges finds in histories of worlds whose true changes are known.
StatusOr<ExperimentResult> RunChanges(EvalContext& context);
/// Not in the paper: localization on a map whose removals were accepted.
StatusOr<ExperimentResult> RunAcceptedChanges(EvalContext& context);
/// Not in the paper: keyframes of EvalContext::recorded (stereo, with ground truth) from a SLAM system that only knows
/// a drifting odometry, in three sessions of one map. NOT_FOUND, INVALID_ARGUMENT: no such recording.
StatusOr<ExperimentResult> RunAdapter(EvalContext& context);

}  // namespace mapp
