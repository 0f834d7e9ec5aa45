#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "server/service/report_budget.h"
#include "server/service/service_types.h"

#include <cstdint>
#include <string>

namespace mapp {

class MapStore;

/// Takes in what devices on shared maps report of its points (DESIGN 10), for the store's history. Thread-safe.
class EvidenceIntake {
 public:
  EvidenceIntake(MapStore& store, const EvidenceLimits& limits) : store_(store), budget_(limits) {}

  /// `packet`: codec/evidence_codec.h. Durable when it returns OK; a (session, number) that is stored is left as it is.
  /// INVALID_ARGUMENT: malformed, empty, or the map has none of the points. NOT_FOUND: no such session.
  /// FAILED_PRECONDITION: it is closed, quarantined or not aligned. RESOURCE_EXHAUSTED: see ReportBudget. Whatever is
  /// refused leaves nothing behind.
  StatusOr<StoredEvidence> Take(const CallContext& context, SessionId session, uint32_t number,
                                const std::string& packet);

 private:
  MapStore& store_;
  ReportBudget budget_;
};

}  // namespace mapp
