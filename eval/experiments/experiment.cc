#include "eval/experiments/experiment.h"

#include <algorithm>
#include <iterator>

namespace mapp {

const std::vector<Experiment>& Experiments() {
  static const std::vector<Experiment> kExperiments = {
      {"traffic", "Upload traffic and freshness per user", {"garage", "plaza"}, RunTraffic},
      {"overhead", "Traffic overhead of queries and responses", {"garage"}, RunOverhead},
      {"hall", "Machine hall: accuracy and traffic per flight", {"hall"}, RunHall},
      {"server", "Server: optimization time and memory against users", {"garage"}, RunServerLoad},
      {"bandwidth", "Server: bandwidth demand of concurrent users", {"garage"}, RunBandwidth},
      {"link", "Upload latency over a limited link", {"garage"}, RunLink},
      {"latency", "Latency of each step", {"hall"}, RunLatency},
      {"ate", "Trajectory error in every setting", {"garage", "plaza", "hall", "city"}, RunTrajectoryError},
      {"lookalikes", "Places that look alike: wrong merges", {"garage", "plaza", "city"}, RunLookAlikes},
      {"alike_images", "The same, rendered", {"garage"}, RunRenderedLookAlikes},
      {"reconstruction", "Map reconstruction error against users", {"garage", "city"}, RunReconstruction},
      {"injection", "Redundancy injection", {"garage"}, RunInjection},
      {"sharing", "Map sharing: what it saves the device", {"garage", "plaza"}, RunSharing},
      {"alpha", "How far a shared map reaches", {"garage"}, RunAlpha},
      {"changes", "Changes of the world: found and invented", {"garage", "hall"}, RunChanges},
      {"accepted", "Accepted removals: what the next device gains", {"garage"}, RunAcceptedChanges},
      {"overlap", "Overlap estimators against the oracle", {"garage", "plaza", "hall"}, RunOverlap},
      {"adapter", "Recorded keyframes through the adapter", {}, RunAdapter, /*needs_recording=*/true},
  };
  return kExperiments;
}

std::vector<std::string> EvalContext::Chosen(const std::vector<std::string>& of) const {
  if (settings.empty()) return of;
  std::vector<std::string> chosen;
  std::ranges::copy_if(of, std::back_inserter(chosen),
                       [this](const std::string& setting) { return std::ranges::count(settings, setting) > 0; });
  return chosen;
}

}  // namespace mapp
