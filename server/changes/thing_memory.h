#pragma once

#include "mapp/base/mutex.h"
#include "server/changes/session_findings.h"
#include "server/changes/thing_course.h"
#include "server/changes/thing_groups.h"
#include "server/changes/thing_visits.h"

#include <Eigen/Core>

#include <map>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

namespace mapp {

/// What a thing's visits tell of it together.
struct ThingVerdict {
  std::optional<Happening> happening;  ///< nullopt: nothing, or too unsurely, or of something that did not stand still
  bool is_sampled = false;             ///< only devices that tell of a sample of points say that it is gone
};

/// All that a verdict on a thing rests on.
struct ThingQuestion {
  GroupEvent event;
  std::span<const MapPointId> ids;
  std::span<const Eigen::Vector3f> p_map;
  std::span<const TellingSession> telling;
};

/// Verdicts of an earlier derivation, so that the next asks views about what is new alone: of a map of years, most has
/// been said before. Thread-safe.
class ThingMemory {
 public:
  /// Begins a derivation: `findings` tell where the frames stood that verdicts rest on.
  void Begin(std::span<const SessionFindings> findings);
  /// The verdict on the same question, but for what refinement moves points and frames by.
  std::optional<ThingVerdict> Find(const ThingQuestion& question);
  void Keep(const ThingQuestion& question, const ThingVerdict& verdict);
  /// Ends it: what nobody asked for since Begin is forgotten.
  void End();

 private:
  struct Entry {
    std::vector<Eigen::Vector3f> p_map;
    ThingVerdict verdict;
    bool is_used = true;
  };

  /// Equal keys ask the same, but for where points are.
  std::string KeyOf(const ThingQuestion& question) const;

  Mutex mutex_;
  std::map<SessionId, uint32_t> frames_crc_;  ///< written by Begin alone
  std::unordered_map<std::string, Entry> entries_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
