#pragma once

#include "bundle/bundle_reader.h"
#include "bundle/bundle_writer.h"
#include "cli/change_info.h"
#include "cli/map_info.h"
#include "mapp/base/status.h"
#include "storage/sqlite/backup.h"
#include "storage/verify.h"

#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace mapp {

/// The operators' side of mapp.v1. One thread only. Errors carry the server's code and message; an answer that does not
/// make sense is DATA_LOSS.
class AdminClient {
 public:
  /// `server`: host:port. Does not connect yet.
  explicit AdminClient(const std::string& server);
  ~AdminClient();

  StatusOr<ServerSummary> GetServerInfo();
  StatusOr<std::vector<MapSummary>> ListMaps();
  /// `at`, here and below: the number of a revision, a tag, or nothing for the present.
  StatusOr<MapSummary> GetMap(const std::string& name, const std::string& at = {});
  /// Numbers of frames and points that went. With `force` also when sessions are open.
  StatusOr<std::pair<uint64_t, uint64_t>> DeleteMap(const std::string& name, bool force);
  /// Of all maps when `map_name` is empty.
  StatusOr<std::vector<SessionSummary>> ListSessions(const std::string& map_name);
  /// Lifts a session's quarantine; the number of frames that the map has taken in for it.
  StatusOr<uint64_t> ReleaseSession(uint64_t session_id);
  /// Takes a session's contribution out of its map.
  StatusOr<RevertedSummary> RevertSession(uint64_t session_id, const std::string& reason, bool dry_run);
  /// Forgets a session; with `force` also an open one.
  StatusOr<ErasedSummary> EraseSession(uint64_t session_id, bool force, bool dry_run);
  /// Everything the map holds, frames by session and number.
  StatusOr<MapContent> ExportMap(const std::string& name, const std::string& at = {});
  StatusOr<RevisionLogSummary> ListRevisions(const std::string& name, uint32_t max_runs);
  StatusOr<MapDiffSummary> DiffRevisions(const std::string& name, const std::string& from, const std::string& to);
  StatusOr<std::vector<TagSummary>> ListTags(const std::string& name);
  /// The revision that the tag names now.
  StatusOr<uint64_t> PutTag(const std::string& name, const std::string& tag, const std::string& at);
  Status DeleteTag(const std::string& name, const std::string& tag);
  /// Tells `on_progress` how far the server is. CANCELLED on a stop request.
  StatusOr<CompactionSummary> CompactMap(const CompactionOrder& order,
                                         const std::function<void(const CompactionStep&)>& on_progress,
                                         const std::stop_token& stop);
  /// Tells `on_progress` how far the server is. CANCELLED on a stop request.
  StatusOr<MapOptimizationSummary> OptimizeMap(const std::string& name,
                                               const std::function<void(const MapOptimizationStep&)>& on_progress,
                                               const std::stop_token& stop);
  /// Has the server write a backup on its machine: of the options `to`, `num_kept`, `dry_run` and `on_progress`.
  /// CANCELLED on a stop request.
  StatusOr<Backup> BackUp(const BackupOptions& options, const std::stop_token& stop);
  /// Has the server look through its database. CANCELLED on a stop request.
  StatusOr<VerifyReport> Verify(const std::function<void(const VerifyProgress&)>& on_progress,
                                const std::stop_token& stop);
  /// Gives a bundle's bytes to `sink`. Only with OK has it its end. CANCELLED on a stop request.
  Status ExportBundle(const std::string& name, const std::string& at, const ByteSink& sink,
                      const std::function<void(const BundleExportStep&)>& on_progress, const std::stop_token& stop);
  /// Sends a bundle, `num_bytes` long, for a map of this name; the bundle's own when it is empty. CANCELLED on a stop
  /// request.
  StatusOr<ImportSummary> ImportBundle(const std::string& name, const ByteSource& bundle, uint64_t num_bytes,
                                       const std::function<void(const BundleImportStep&)>& on_progress,
                                       const std::stop_token& stop);
  /// Has the server look through a map's history for changes of the world. Tells `on_progress` how far the server is.
  /// CANCELLED on a stop request; what was done is kept.
  StatusOr<ChangeDetectionSummary> DetectChanges(const ChangeDetectionOrder& order,
                                                 const std::function<void(const ChangeDetectionStep&)>& on_progress,
                                                 const std::stop_token& stop);
  /// By id.
  StatusOr<std::vector<ChangeSummary>> ListChanges(const std::string& name);
  /// All of these changes or none, here and below.
  StatusOr<ChangeDecisionSummary> AcceptChanges(const std::string& name, const std::vector<uint64_t>& ids);
  StatusOr<ChangeDecisionSummary> RejectChanges(const std::string& name, const std::vector<uint64_t>& ids);
  StatusOr<ChangeDecisionSummary> UndoChanges(const std::string& name, const std::vector<uint64_t>& ids);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
