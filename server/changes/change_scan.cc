#include "server/changes/change_scan.h"

#include "mapp/base/mutex.h"
#include "mapp/base/parallel.h"
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

/// Findings on their way to the store. What was made is kept though the call has ended meanwhile.
class FindingsKeeper {
 public:
  explicit FindingsKeeper(MapStore& store) : store_(store) {}

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
    MAPP_RETURN_IF_ERROR(store_.Write({}, put));
    waiting_.clear();
    return absl::OkStatus();
  }

 private:
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

/// Makes those of `findings` that are missing (indices), each on a thread, and puts them into the store.
Status MakeMissing(const CallContext& context, MapStore& store, std::span<const size_t> missing, FindingsMaker& maker,
                   int num_threads, std::vector<SessionFindings>& findings,
                   const std::function<void(const ScanProgress&)>& on_progress) {
  Mutex mutex;
  FindingsKeeper keeper(store);
  Status outcome;
  size_t num_made = 0;
  // One that is alone has all threads.
  const int num_inside = std::max(1, num_threads / static_cast<int>(std::max<size_t>(1, missing.size())));
  ParallelFor(num_threads, static_cast<int>(missing.size()), [&](int i) {
    SessionFindings& one = findings[missing[static_cast<size_t>(i)]];
    {
      const MutexLock lock(mutex);
      if (!outcome.ok()) return;
    }
    StatusOr<SessionFindings> made = maker.Make(context, one.session, num_inside);
    const MutexLock lock(mutex);
    if (made.ok()) one = *std::move(made);
    if (outcome.ok()) outcome = made.ok() ? keeper.Keep(one) : made.status();
    ++num_made;
    if (outcome.ok() && on_progress) {
      on_progress({.num_sessions_done = findings.size() - missing.size() + num_made, .num_sessions = findings.size()});
    }
  });
  const Status flushed = keeper.Flush();
  return outcome.ok() ? flushed : outcome;
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
  std::vector<size_t> missing;
  for (const SessionRecord& session : telling) {
    const std::span<const FrameRecord> frames_of_session = maker.FramesOf(session.id);
    MAPP_ASSIGN_OR_RETURN(std::optional<SessionFindings> kept, FindKept(*reader, session.id, frames_of_session));
    if (!kept && !frames_of_session.empty()) missing.push_back(findings.size());
    findings.push_back(kept ? *std::move(kept) : SessionFindings{session.id, {}, {}, {}, false});
  }
  scan.num_sessions_read = missing.size();
  MAPP_RETURN_IF_ERROR(
      MakeMissing(context, store, missing, maker, options.derivation.num_threads, findings, on_progress));
  for (SessionFindings& of_session : findings) AddEvidence(evidence[of_session.session], of_session);
  MAPP_ASSIGN_OR_RETURN(scan.changes, DeriveChanges(context, *reader, scan.map.id, sessions, frames, findings, maker,
                                                    options.derivation, memory));
  for (ChangeRecord& change : scan.changes) change.detected = scan.map.revision;
  return scan;
}

}  // namespace mapp
