#include "eval/harness/report_folder.h"

#include "eval/harness/eval_server.h"
#include "eval/harness/plot_script.h"
#include "text/file_io.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <thread>
#include <utility>

namespace mapp {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kPlotTimeout{120};

/// Replaces a file as a whole.
Status Replace(const fs::path& file, const std::string& content) {
  const fs::path partial = file.string() + ".partial";
  MAPP_RETURN_IF_ERROR(WriteOutput(partial.string(), content, std::cout));
  std::error_code error;
  fs::rename(partial, file, error);
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", file.string(), error.message()));
  return absl::OkStatus();
}

std::string FirstLineWith(const std::string& file, const std::string& key) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    const size_t colon = line.find(':');
    if (line.starts_with(key) && colon != std::string::npos) return line.substr(line.find_first_not_of(' ', colon + 1));
  }
  return "unknown";
}

}  // namespace

std::string DescribeMachine() {
  const std::string memory = FirstLineWith("/proc/meminfo", "MemTotal");
  return fmt::format("{}, {} cores, {:.0f} GB", FirstLineWith("/proc/cpuinfo", "model name"),
                     std::thread::hardware_concurrency(), std::strtod(memory.c_str(), nullptr) * 1e-6);
}

StatusOr<ReportFolder> ReportFolder::OpenExisting(const std::string& folder) {
  const std::string file = (fs::path(folder) / "results.json").string();
  MAPP_ASSIGN_OR_RETURN(const std::string json, ReadInput(file));
  MAPP_ASSIGN_OR_RETURN(ResultSet results, ParseResults(json, file));
  return ReportFolder(folder, std::move(results));
}

StatusOr<ReportFolder> ReportFolder::Open(const std::string& folder, const ResultSet& header) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", folder, error.message()));
  if (!fs::exists(fs::path(folder) / "results.json")) return ReportFolder(folder, header);
  MAPP_ASSIGN_OR_RETURN(ReportFolder existing, OpenExisting(folder));
  if (existing.results_.scale != header.scale || existing.results_.seed != header.seed) {
    return absl::FailedPreconditionError(fmt::format(
        "{} holds results of {} scale with seed {}, asked for are {} scale and seed {}: choose another --out", folder,
        existing.results_.scale, existing.results_.seed, header.scale, header.seed));
  }
  ResultSet results = header;
  results.experiments = existing.results_.experiments;
  return ReportFolder(folder, std::move(results));
}

Status ReportFolder::Add(ExperimentResult result, const std::stop_token& stop) {
  Merge(std::move(result), results_);
  MAPP_RETURN_IF_ERROR(Replace(fs::path(folder_) / "results.json", FormatResults(results_)));
  return Write(stop);
}

Status ReportFolder::Write(const std::stop_token& stop) {
  const fs::path folder(folder_);
  for (const ExperimentResult& result : results_.experiments) {
    for (const ResultTable& table : result.tables) {
      MAPP_RETURN_IF_ERROR(Replace(folder / (table.id + ".csv"), FormatCsv(table)));
    }
  }
  const std::string script = (folder / "plot_results.py").string();
  const std::string log = (folder / "plot_results.log").string();
  MAPP_RETURN_IF_ERROR(Replace(script, kPlotScript));
  ChildOptions child;
  child.command = {"/usr/bin/python3", script, (folder / "results.json").string(), folder_};
  child.output_file = log;
  child.error_file = log;
  plots_missing_.clear();
  if (StatusOr<std::unique_ptr<ChildProcess>> python = ChildProcess::Start(child); !python.ok()) {
    plots_missing_ = std::string(python.status().message());
  } else if (const Status drawn = WaitFor(**python, "drawing plots", log, kPlotTimeout, stop); !drawn.ok()) {
    if (absl::IsCancelled(drawn)) return drawn;
    plots_missing_ = std::string(drawn.message());
  }
  std::error_code ignored;  // the log is of use only while plots are missing
  fs::remove(script, ignored);
  if (plots_missing_.empty()) fs::remove(log, ignored);
  return Replace(folder / "REPORT.md", FormatReport(results_, plots_missing_.empty()));
}

}  // namespace mapp
