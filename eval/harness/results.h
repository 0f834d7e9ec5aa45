#pragma once

#include "mapp/base/status.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace mapp {

/// A table's cell: a number, a text, or nothing where there is no figure.
struct Cell {
  std::optional<double> number;
  std::string text;  ///< of a cell without number

  Cell() = default;
  Cell(double value) : number(value) {}  // NOLINT(google-explicit-constructor): rows are lists of values
  Cell(const std::optional<double>& value) : number(value) {}  // NOLINT(google-explicit-constructor)
  Cell(std::string words) : text(std::move(words)) {}          // NOLINT(google-explicit-constructor)
  Cell(const char* words) : text(words) {}                     // NOLINT(google-explicit-constructor)
};

struct Column {
  std::string name;  ///< with its unit: "upload, KB/keyframe"
  int digits = 2;    ///< after the decimal point, in the report
};

/// How a table is drawn: one line or group of bars a column.
struct Plot {
  enum class Kind { kBars, kLines };
  Kind kind = Kind::kBars;
  std::string x;               ///< name of the column along x
  std::vector<std::string> y;  ///< names of the columns drawn
  std::string y_label;
};

struct ResultTable {
  std::string id;  ///< file name of its CSV and plot: letters, digits, '-' and '_'
  std::string title;
  std::vector<Column> columns;
  std::vector<std::vector<Cell>> rows;
  std::optional<Plot> plot;
};

/// What one experiment found.
struct ExperimentResult {
  std::string name;  ///< as `mapp eval` takes it
  std::string title;
  std::string setup;  ///< worlds, users, level and policies of this run
  std::string paper;  ///< what the paper reports for it
  std::vector<ResultTable> tables;
  std::vector<std::string> remarks;  ///< what a reader must know to judge the figures
  double duration_s = 0;
};

/// All results of one folder, with what they were made on.
struct ResultSet {
  std::string version;  ///< of the program
  std::string commit;
  std::string machine;
  std::string command;
  std::string scale;  ///< "quick" or "full"
  uint64_t seed = 0;
  std::vector<ExperimentResult> experiments;
};

/// Replaces the experiment of the same name, or adds it.
void Merge(ExperimentResult result, ResultSet& results);

std::string FormatResults(const ResultSet& results);
/// DATA_LOSS: no results file. FAILED_PRECONDITION: one of another format, both numbers named.
StatusOr<ResultSet> ParseResults(const std::string& json, const std::string& file);

/// RFC 4180.
std::string FormatCsv(const ResultTable& table);
/// REPORT.md: every table beside the paper's figures, then how it was made. Plots are linked where `has_plots`.
std::string FormatReport(const ResultSet& results, bool has_plots);

}  // namespace mapp
