#include "server/changes/change_scan.h"

#include "mapp/base/unix_time.h"
#include "server/changes/device_evidence.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

namespace mapp {
namespace {

/// Sessions that have told are kept in the store together, to spare the disk.
constexpr size_t kKeptAtATime = 16;

std::string Since(int64_t from_ns, int64_t to_ns) {
  std::string text;
  if (from_ns != std::numeric_limits<int64_t>::min()) text += " since " + FormatUtc(from_ns);
  if (to_ns != std::numeric_limits<int64_t>::max()) text += " until " + FormatUtc(to_ns);
  return text;
}

Status NothingTells(const MapRecord& map, const std::vector<SessionRecord>& in_map, const DerivationOptions& options) {
  if (in_map.empty()) return absl::FailedPreconditionError(fmt::format("map \"{}\" has no keyframes yet", map.name));
  const auto [first, last] = std::ranges::minmax(in_map, {}, &SessionRecord::opened_ns);
  return absl::FailedPreconditionError(
      fmt::format("map \"{}\": no session was opened{}; its sessions were from {} to {}", map.name,
                  Since(options.from_ns, options.to_ns), FormatUtc(first.opened_ns), FormatUtc(last.opened_ns)));
}

/// Findings on their way to the store.
class FindingsKeeper {
 public:
  FindingsKeeper(const CallContext& context, MapStore& store) : context_(context), store_(store) {}

  Status Keep(const SessionFindings& findings) {
    waiting_.emplace_back(findings.session, EncodeFindings(findings));
    return waiting_.size() < kKeptAtATime ? absl::OkStatus() : Flush();
  }

  Status Flush() {
    if (waiting_.empty()) return absl::OkStatus();
    const auto put = [&](MapWriter& writer) -> Status {
      for (const auto& [session, blob] : waiting_) {
        const Status kept = writer.PutFindings(session, blob);
        // Its contributor was forgotten meanwhile.
        if (!kept.ok() && !absl::IsNotFound(kept)) return kept;
      }
      return absl::OkStatus();
    };
    MAPP_RETURN_IF_ERROR(store_.Write(context_, put));
    waiting_.clear();
    return absl::OkStatus();
  }

 private:
  const CallContext& context_;
  MapStore& store_;
  std::vector<std::pair<SessionId, std::string>> waiting_;
};

/// What the store holds of the session, if it is still right.
StatusOr<std::optional<SessionFindings>> FindKept(MapReader& reader, SessionId session,
                                                  std::span<const FrameRecord> frames) {
  StatusOr<std::optional<std::string>> blob = reader.FindFindings(session);
  if (absl::IsDataLoss(blob.status())) return std::nullopt;  // derived: made again
  if (!blob.ok()) return blob.status();
  if (!blob->has_value()) return std::nullopt;
  StatusOr<SessionFindings> kept = DecodeFindings(**blob);
  if (!kept.ok() || kept->session != session || !kept->RestsOn(frames)) return std::nullopt;
  return *std::move(kept);
}

/// Adds what the session's device has reported to what its views say. Not kept with the findings: reports may follow.
void AddEvidence(std::span<const PointFinding> evidence, SessionFindings& findings) {
  if (evidence.empty()) return;
  findings.has_evidence = true;
  findings.own.insert(findings.own.end(), evidence.begin(), evidence.end());
  std::ranges::stable_sort(findings.own, {}, &PointFinding::point);
  findings.own = MergeFindings(findings.own);
}

}  // namespace

StatusOr<ChangeScan> ScanForChanges(const CallContext& context, MapStore& store, const std::string& map_name,
                                    const ScanOptions& options, ThingMemory& memory,
                                    const std::function<void(const ScanProgress&)>& on_progress) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  ChangeScan scan;
  MAPP_ASSIGN_OR_RETURN(scan.map, reader->FindMap(map_name));
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, reader->ListSessions(scan.map.id));
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> frames, reader->ListFrames(scan.map.id, std::nullopt));
  std::erase_if(frames, [](const FrameRecord& frame) { return !frame.in_map; });
  std::ranges::sort(frames, {}, &FrameRecord::id);
  FindingsMaker maker(*reader, scan.map, sessions, frames, options.findings);
  std::vector<SessionRecord> in_map, telling;
  std::map<SessionId, std::vector<PointFinding>> evidence;
  for (const SessionRecord& session : sessions) {
    // Nobody believes what a device reported that was quarantined later.
    if (!session.IsQuarantined()) {
      MAPP_ASSIGN_OR_RETURN(evidence[session.id], FindingsOfEvidence(*reader, session.id));
    }
    if (maker.FramesOf(session.id).empty() && evidence[session.id].empty()) continue;
    in_map.push_back(session);
    const bool in_time =
        session.opened_ns >= options.derivation.from_ns && session.opened_ns <= options.derivation.to_ns;
    if (in_time) telling.push_back(session);
  }
  if (telling.empty()) return NothingTells(scan.map, in_map, options.derivation);
  std::ranges::sort(telling, {}, &SessionRecord::id);
  scan.num_sessions = telling.size();

  std::vector<SessionFindings> findings;
  FindingsKeeper keeper(context, store);
  for (const SessionRecord& session : telling) {
    MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(std::optional<SessionFindings> kept,
                          FindKept(*reader, session.id, maker.FramesOf(session.id)));
    if (!kept && maker.FramesOf(session.id).empty()) {
      kept = SessionFindings{.session = session.id, .frames = {}, .own = {}, .earlier = {}};
    }
    if (!kept) {
      MAPP_ASSIGN_OR_RETURN(kept, maker.Make(context, session.id));
      MAPP_RETURN_IF_ERROR(keeper.Keep(*kept));
      ++scan.num_sessions_read;
    }
    AddEvidence(evidence[session.id], *kept);
    findings.push_back(*std::move(kept));
    if (on_progress) on_progress({.num_sessions_done = findings.size(), .num_sessions = telling.size()});
  }
  MAPP_RETURN_IF_ERROR(keeper.Flush());
  MAPP_ASSIGN_OR_RETURN(scan.changes, DeriveChanges(context, *reader, scan.map.id, sessions, frames, findings, maker,
                                                    options.derivation, memory));
  for (ChangeRecord& change : scan.changes) change.detected = scan.map.revision;
  return scan;
}

}  // namespace mapp
