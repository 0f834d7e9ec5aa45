#include "server/service/step_times.h"

namespace mapp {

void StepTimes::Add(ServiceStep step, std::chrono::nanoseconds duration) {
  const MutexLock lock(mutex_);
  recorders_.at(static_cast<size_t>(step)).Add(duration);
}

std::vector<StepFigures> StepTimes::Snapshot() const {
  constexpr std::array<const char*, 3> kNames = {"integration", "alignment", "optimization"};
  const MutexLock lock(mutex_);
  std::vector<StepFigures> figures;
  for (size_t i = 0; i < kNames.size(); ++i) figures.push_back({kNames.at(i), recorders_.at(i).Summary()});
  return figures;
}

}  // namespace mapp
