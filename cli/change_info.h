#pragma once

#include "mapp/geometry/oriented_box.h"
#include "storage/records.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// What AdminService tells of changes of the world, for the commands that print and draw them.
struct ChangeSummary {
  uint64_t id = 0;
  ChangeKind kind = ChangeKind::kVanished;
  ChangeStatus status = ChangeStatus::kProposed;
  double confidence = 0;  ///< probability in [0, 1] that it has happened
  /// It happened between these, Unix times: openings of the last session that found things as before, and of the first
  /// that did not.
  int64_t after_unix_ns = 0, before_unix_ns = 0;
  /// Openings of the first and the last session that saw the thing where it was (kAppeared: where it is).
  int64_t first_seen_unix_ns = 0, last_seen_unix_ns = 0;
  std::vector<uint64_t> session_ids;          ///< whose evidence it rests on
  std::optional<OrientedBox> box_map_before;  ///< where the thing was (kVanished, kMoved)
  std::optional<OrientedBox> box_map_after;   ///< where it is (kAppeared, kMoved)
  std::vector<uint64_t> points_before, points_after;
  uint64_t detected_revision = 0;  ///< the map's when it was found
  uint64_t applied_revision = 0;   ///< that its acceptance made; 0: none
};

/// Where to look for changes, and what to do with them.
struct ChangeDetectionOrder {
  std::string map_name;
  int64_t from_unix_ns = 0;  ///< sessions opened from then on tell; 0: since ever
  int64_t to_unix_ns = 0;    ///< and until then; 0: now
  double auto_accept = 0;    ///< what is proposed and at least this sure is accepted at once, in (0, 1]; 0: nothing
};

/// How far a detection is.
struct ChangeDetectionStep {
  uint32_t num_sessions_done = 0, num_sessions = 0;
};

struct ChangeDetectionSummary {
  std::vector<ChangeSummary> changes;  ///< that the time asked about tells of, by id
  uint32_t num_new = 0;
  uint32_t num_dropped = 0;        ///< proposed earlier, and no more now
  uint32_t num_accepted = 0;       ///< by auto_accept
  uint32_t num_sessions_read = 0;  ///< whose keyframes were looked at again
  uint32_t num_sessions = 0;
  double seconds = 0;
};

/// What accepting, rejecting or undoing has done.
struct ChangeDecisionSummary {
  std::vector<ChangeSummary> changes;  ///< as they are now, by id
  uint64_t map_revision = 0;           ///< that it made; 0: the map stays as it was
  uint64_t num_points = 0;             ///< that were retired, or live again
};

}  // namespace mapp
