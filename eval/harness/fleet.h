#pragma once

#include "eval/harness/figures.h"
#include "eval/metrics/reconstruction_metrics.h"
#include "mapp/base/process_usage.h"
#include "mapp/base/status.h"
#include "mapp/client/participant.h"
#include "sim/world/visit.h"

#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// What a device sees of a simulated world: drawn images, or features made from the scene directly.
enum class Level { kRendered, kFeatures };
const char* LevelName(Level level);

/// How a device takes part: what is compared.
struct Policy {
  std::string name;
  std::string title;  ///< in tables
  ParticipantOptions participation;
};

/// upload_all, depth_sketch, uniform, occupancy, no_injection, random_injection, no_sharing, and, apart by how far
/// shared maps reach, alpha_1, alpha_1.3, look_ahead_10, look_ahead_20. Programmer's error for another name.
const Policy& PolicyNamed(const std::string& name);

/// The options of `mapp replay` that give a device these settings.
std::vector<std::string> ReplayArguments(const ParticipantOptions& participation);

/// The name of the map that a fleet builds.
inline constexpr const char* kEvalMapName = "eval";

/// One device's turn.
struct Participation {
  int visit = 0;       ///< of the simulation
  std::string policy;  ///< as PolicyNamed takes it
  /// Name of a tile cache that it shares with the fleet's devices of the same; empty: none.
  std::string tile_cache = {};
};

/// Devices that build and use one map in a simulated world, one after the other or at the same time.
struct FleetSpec {
  sim::SimulationOptions world;
  Level level = Level::kFeatures;
  std::vector<Participation> devices;
  bool concurrent = false;
  bool reconstruct = false;  ///< compare the map's points with the true surfaces after each device

  /// Equal for fleets that do the same.
  std::string Key() const;
};

/// All visits of the world under one policy.
FleetSpec FleetOf(const sim::SimulationOptions& world, Level level, const std::string& policy);

struct DeviceFigures {
  Figures report;             ///< `mapp replay --json`
  Figures server;             ///< `mapp server-info --json` once the session was closed and the map optimized
  ProcessUsage server_usage;  ///< likewise, since the server's start
  std::optional<ReconstructionError> reconstruction;
};

struct FleetFigures {
  std::vector<DeviceFigures> devices;  ///< in the order of FleetSpec::devices
  std::string database;                ///< the map's file; the server has ended
  /// Of the first device: where it was, and where it took itself to be. They tell where the map lies in the world.
  std::string first_truth_file;
  std::string first_trajectory_file;
  uint64_t database_bytes = 0;
  double duration_s = 0;
};

/// Value of a report's figure for each device that has it.
std::vector<double> Collect(const FleetFigures& fleet, const std::string& path);
/// Sum and mean of Collect(); the mean is absent when no device has the figure.
double SumOf(const FleetFigures& fleet, const std::string& path);
std::optional<double> MeanOf(const FleetFigures& fleet, const std::string& path);

}  // namespace mapp
