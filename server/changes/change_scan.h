#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "server/changes/change_detector.h"
#include "server/changes/session_findings.h"
#include "storage/records.h"

#include <functional>
#include <vector>

namespace mapp {

class MapStore;

struct ScanOptions {
  FindingsOptions findings;
  /// With the time whose sessions tell, and the threads that look.
  DerivationOptions derivation;
};

struct ScanProgress {
  size_t num_sessions_done = 0;
  size_t num_sessions = 0;
};

/// What a map's history tells of the world.
struct ChangeScan {
  MapRecord map;  ///< as it was read
  std::vector<ChangeRecord> changes;
  size_t num_sessions = 0;       ///< that told
  size_t num_sessions_read = 0;  ///< of them, those whose keyframes were read; of the others the store held findings
};

/// Looks through the history in the state of one commit, and puts what it finds out of single sessions into the store
/// as it goes (MapWriter::PutFindings), so that the next scan reads what is new. What devices have reported
/// (device_evidence.h) counts with it. `memory`: of earlier scans of this map, or empty. `on_progress` (may be empty)
/// is told on any thread, on one at a time. NOT_FOUND: no such map. FAILED_PRECONDITION: no session with frames in the
/// map, or reports of it, was opened in that time. DATA_LOSS: a report is damaged; `mapp verify` names all that are.
StatusOr<ChangeScan> ScanForChanges(const CallContext& context, MapStore& store, const std::string& map_name,
                                    const ScanOptions& options, ThingMemory& memory,
                                    const std::function<void(const ScanProgress&)>& on_progress);

}  // namespace mapp
