#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <ostream>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

struct EvalOptions {
  std::vector<std::string> experiments;  ///< names, or "all"
  bool quick = false;
  std::vector<std::string> settings;  ///< to measure in; empty: all
  uint64_t seed = 1;
  std::string out;
  std::vector<std::string> flights;  ///< TUM files, T_world_camera; flown at full scale
  std::string recorded;              ///< folder of a recorded stereo sequence with ground truth; empty: none
  bool keep_work = false;            ///< databases, logs and reports of the runs stay in OUT/work
  std::string command;               ///< as typed, for the report
  bool json = false;
};

/// Names and titles of the experiments, a line each.
std::string ListExperiments();

/// `mapp eval EXPERIMENT...|all`: runs experiments against servers of its own and writes results.json, CSV, plots and
/// REPORT.md to `out` after each. INVALID_ARGUMENT: no such experiment, or none of its settings chosen. Errors else as
/// Lab's and ReportFolder's.
Status RunEval(const EvalOptions& options, const std::stop_token& stop, std::ostream& out);

/// `mapp eval report`: writes CSV, plots and REPORT.md anew from the results.json of `options.out`.
Status RunEvalReport(const EvalOptions& options, const std::stop_token& stop, std::ostream& out);

}  // namespace mapp
