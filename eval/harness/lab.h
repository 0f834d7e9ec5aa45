#pragma once

#include "eval/harness/fleet.h"
#include "mapp/base/status.h"
#include "mapp/client/participant.h"

#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

namespace mapp {

/// The programs that are measured: those that an operator runs.
struct Programs {
  std::string mapp;
  std::string mapp_server;
};
/// The two beside the program that is running. NOT_FOUND naming the one that is not there.
StatusOr<Programs> FindPrograms();

/// A device without images: what it plays and where its files go.
struct FeatureRun {
  std::string server;
  std::string map_name;
  std::string device;
  ParticipantOptions participation;
  std::shared_ptr<const sim::Simulation> simulation;
  int visit = 0;
  std::string json_file;
  std::string trajectory_file;
  std::string truth_file;
  std::string first_truth_file;          ///< of the map's first session, to judge by; empty: none
  std::string first_trajectory_file;     ///< likewise
  std::chrono::milliseconds patience{};  ///< as mapp replay's
};

struct LabOptions {
  Programs programs;
  std::string work_folder;  ///< databases, logs and reports of the runs; must exist
  /// Told what begins: "garage, 4 users, depth sketch: user 2 of 4".
  std::function<void(const std::string&)> on_progress;
  /// Plays a device at the feature level in this process: what a world looks like is then worked out once for all.
  /// Called from several threads at once where devices come together.
  std::function<Status(const FeatureRun&, const std::stop_token&)> play_features;
  /// A session may take so long at most.
  std::chrono::minutes session_timeout{30};
};

/// Runs fleets against real servers in processes of their own. What was run once is not run again: experiments that
/// look at the same runs share them. One thread.
class Lab {
 public:
  Lab(LabOptions options, std::stop_token stop);
  ~Lab();

  /// CANCELLED on a stop request. ABORTED naming program, exit code and log when a process fails.
  StatusOr<std::shared_ptr<const FleetFigures>> Run(const FleetSpec& spec);
  /// The simulation that a fleet runs in.
  StatusOr<std::shared_ptr<const sim::Simulation>> WorldOf(const sim::SimulationOptions& options);

  const LabOptions& options() const { return options_; }
  const std::stop_token& stop() const { return stop_; }

 private:
  struct Impl;
  LabOptions options_;
  std::stop_token stop_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
