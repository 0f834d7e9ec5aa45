#include "server/changes/device_evidence.h"

#include "mapp/codec/evidence_codec.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp {

StatusOr<std::vector<PointFinding>> FindingsOfEvidence(MapReader& reader, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<EvidenceRecord> reports, reader.ListEvidence(session));
  std::vector<PointFinding> findings;
  for (const EvidenceRecord& report : reports) {
    const StatusOr<std::vector<PointFinding>> found = DecodeEvidence(report.packet);
    if (!found.ok()) {
      return absl::DataLossError(fmt::format("evidence {} of session {}: {}", report.number, session.value(),
                                             std::string(found.status().message())));
    }
    findings.insert(findings.end(), found->begin(), found->end());
  }
  std::ranges::stable_sort(findings, {}, &PointFinding::point);
  return MergeFindings(findings);
}

}  // namespace mapp
