#include "eval/harness/visit_name.h"

#include "eval/harness/choices.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace mapp {

std::string VisitName(const sim::SimulationOptions& options, int user) {
  std::string name = fmt::format("sim:{}:users={},path={},seed={},sensor={}", options.setting, options.num_users,
                                 options.path_m, options.seed, NameOf(kSensorChoices, options.sensor));
  if (options.rate_hz > 0) name += fmt::format(",rate={}", options.rate_hz);
  if (!options.cameras.empty()) name += fmt::format(",camera={}", fmt::join(options.cameras, "+"));
  if (options.num_changes > 0) name += fmt::format(",changes={}", options.num_changes);
  if (options.change_reach_m > 0) name += fmt::format(",changes-near={}", options.change_reach_m);
  for (size_t i = 0; i < options.change_kinds.size(); ++i) {
    name += (i == 0 ? ",change-kinds=" : "+") + NameOf(kChangeKindChoices, options.change_kinds[i]);
  }
  if (options.num_stable_visits > 0) name += fmt::format(",stable={}", options.num_stable_visits);
  if (options.num_passers > 0) name += fmt::format(",passers={}", options.num_passers);
  if (options.num_routes > 0) name += fmt::format(",routes={}", options.num_routes);
  if (options.max_duration_s > 0) name += fmt::format(",max-duration={}", options.max_duration_s);
  if (!options.trajectory_files.empty()) {
    name += fmt::format(",trajectory={}", fmt::join(options.trajectory_files, "+"));
  }
  if (!options.textures_folder.empty()) name += fmt::format(",textures={}", options.textures_folder);
  return fmt::format("{}/{}", name, user);
}

}  // namespace mapp
