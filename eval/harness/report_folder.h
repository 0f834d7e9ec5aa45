#pragma once

#include "eval/harness/results.h"
#include "mapp/base/status.h"

#include <stop_token>
#include <string>

namespace mapp {

/// A folder with results.json, a CSV a table, plots and REPORT.md. What is in it is always whole: files are replaced,
/// not rewritten in place.
class ReportFolder {
 public:
  /// Takes up a folder: made when absent; what results it holds are kept and added to. RESOURCE_EXHAUSTED naming the
  /// folder when it cannot be written, FAILED_PRECONDITION when its results are of another format, scale or seed.
  static StatusOr<ReportFolder> Open(const std::string& folder, const ResultSet& header);
  /// The results that a folder holds. NOT_FOUND when there are none.
  static StatusOr<ReportFolder> OpenExisting(const std::string& folder);

  /// Adds an experiment, or replaces it, and writes everything anew.
  Status Add(ExperimentResult result, const std::stop_token& stop);
  /// Writes CSV files, plots and REPORT.md from the results as they stand. Plots need Python 3 with matplotlib; without
  /// them the report has none, and `plots_missing` says why.
  Status Write(const std::stop_token& stop);

  const ResultSet& results() const { return results_; }
  const std::string& plots_missing() const { return plots_missing_; }

 private:
  ReportFolder(std::string folder, ResultSet results) : folder_(std::move(folder)), results_(std::move(results)) {}

  std::string folder_;
  ResultSet results_;
  std::string plots_missing_;
};

/// Processor, number of cores and memory, on one line.
std::string DescribeMachine();

}  // namespace mapp
