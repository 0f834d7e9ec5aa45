#include "server/service/compaction.h"

#include "storage/map_store.h"

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// A change takes a fraction of a second with these: uploads wait no longer.
constexpr int64_t kRowsAtATime = 20'000;
constexpr int64_t kBytesAtATime = int64_t{4} << 20;

/// The revision that was the present one at `unix_ns`.
StatusOr<Revision> RevisionAt(MapReader& reader, const MapRecord& map, int64_t unix_ns) {
  // Times grow with the revisions, but for a clock that was set back: then the result is one of those around it.
  uint64_t low = 0, high = map.revision.value();
  while (low < high) {
    const uint64_t middle = low + (high - low + 1) / 2;
    MAPP_ASSIGN_OR_RETURN(const std::vector<RevisionRecord> revision,
                          reader.ListRevisions(map.id, Revision(middle), Revision(middle)));
    if (!revision.empty() && revision.front().committed_ns <= unix_ns) {
      low = middle;
    } else {
      high = middle - 1;
    }
  }
  return Revision(low);
}

/// Fills oldest_before, oldest and kept_for.
StatusOr<Compaction> Plan(MapReader& reader, const MapRecord& map, const CompactionRequest& request, int64_t now_ns) {
  if (!request.keep_revisions && !request.keep_days) {
    return absl::InvalidArgumentError("say what to keep: --keep-revisions or --keep-days");
  }
  Compaction plan;
  plan.oldest_before = map.oldest_revision;
  plan.oldest = map.revision;
  if (request.keep_revisions) {
    const uint64_t present = map.revision.value();
    plan.oldest = std::min(plan.oldest, Revision(present - std::min(present, *request.keep_revisions)));
  }
  if (request.keep_days) {
    const double back_ns = *request.keep_days * 24 * 3600 * 1e9;
    if (!(back_ns >= 0) || back_ns > static_cast<double>(now_ns)) {
      return absl::InvalidArgumentError("keep_days: must be at least 0 and not before 1970");
    }
    MAPP_ASSIGN_OR_RETURN(const Revision then, RevisionAt(reader, map, now_ns - static_cast<int64_t>(back_ns)));
    plan.oldest = std::min(plan.oldest, then);
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, reader.ListTags(map.id));
  for (const TagRecord& tag : tags) {
    // A tag of what is gone already keeps nothing.
    if (tag.revision >= plan.oldest || tag.revision < map.oldest_revision) continue;
    plan.oldest = tag.revision;
    plan.kept_for = tag;
  }
  plan.oldest = std::max(plan.oldest, plan.oldest_before);
  return plan;
}

StatusOr<Compaction> DropAndGiveBack(MapStore& store, const CallContext& context, const CompactionRequest& request,
                                     int64_t now_ns, const CompactionObserver& on_progress) {
  Compaction compaction;
  MapRecord map;
  CompactionProgress progress;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(map, reader->FindMap(request.map_name));
    MAPP_ASSIGN_OR_RETURN(compaction, Plan(*reader, map, request, now_ns));
    MAPP_ASSIGN_OR_RETURN(progress.rows_total, reader->CountHistory(map.id, compaction.oldest));
  }
  if (request.dry_run) {
    compaction.num_rows = progress.rows_total;
    return compaction;
  }
  const auto tell = [&] {
    if (on_progress) on_progress(progress);
  };
  for (int64_t num_dropped = -1; num_dropped != 0;) {
    tell();
    MAPP_RETURN_IF_ERROR(store.Write(context, [&](MapWriter& writer) -> Status {
      MAPP_ASSIGN_OR_RETURN(num_dropped, writer.DropHistory(map.id, compaction.oldest, kRowsAtATime));
      return absl::OkStatus();
    }));
    progress.rows_done += num_dropped;
  }
  compaction.num_rows = progress.rows_done;
  for (int64_t before = -1;;) {
    MAPP_RETURN_IF_ERROR(store.Write(context, [&](MapWriter& writer) -> Status {
      // The first step only tells how much there is.
      MAPP_ASSIGN_OR_RETURN(progress.bytes_left, writer.GiveBackSpace(before < 0 ? 1 : kBytesAtATime));
      return absl::OkStatus();
    }));
    tell();
    // Uploads use free space meanwhile, and may even leave more.
    if (before >= 0) compaction.num_bytes_given_back += std::max<int64_t>(0, before - progress.bytes_left);
    if (progress.bytes_left == 0 || progress.bytes_left == before) return compaction;
    before = progress.bytes_left;
  }
}

}  // namespace

StatusOr<Compaction> CompactMap(MapStore& store, const CallContext& context, const CompactionRequest& request,
                                int64_t now_ns, const CompactionObserver& on_progress) {
  MAPP_ASSIGN_OR_RETURN(Compaction compaction, DropAndGiveBack(store, context, request, now_ns, on_progress));
  if (request.rewrite && !request.dry_run) MAPP_RETURN_IF_ERROR(store.Rewrite(context));
  return compaction;
}

}  // namespace mapp
