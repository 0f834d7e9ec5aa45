#include "eval/experiments/experiment.h"

namespace mapp {

const std::vector<Experiment>& Experiments() {
  static const std::vector<Experiment> kExperiments = {
      {"traffic", "Upload traffic and freshness per user", RunTraffic},
      {"overhead", "Traffic overhead of queries and responses", RunOverhead},
      {"hall", "Machine hall: accuracy and traffic per flight", RunHall},
      {"server", "Server: optimization time and memory against users", RunServerLoad},
      {"bandwidth", "Server: bandwidth demand of concurrent users", RunBandwidth},
      {"link", "Upload latency over a limited link", RunLink},
      {"latency", "Latency of each step", RunLatency},
      {"ate", "Trajectory error in every setting", RunTrajectoryError},
      {"reconstruction", "Map reconstruction error against users", RunReconstruction},
      {"injection", "Redundancy injection", RunInjection},
      {"sharing", "Map sharing: what it saves the device", RunSharing},
      {"alpha", "Oversharing factor", RunAlpha},
      {"overlap", "Overlap estimators against the oracle", RunOverlap},
  };
  return kExperiments;
}

}  // namespace mapp
