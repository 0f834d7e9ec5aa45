#include "server/service/map_history.h"

#include "storage/map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>

namespace mapp {
namespace {

/// Revisions read at a time, going back.
constexpr uint64_t kRevisionsAtATime = 1000;

std::optional<uint64_t> ParseNumber(const std::string& text) {
  uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

/// Names devices by their sessions, each asked for once.
class Devices {
 public:
  explicit Devices(MapReader& reader) : reader_(reader) {}
  StatusOr<std::string> NameOf(SessionId session) {
    auto known = names_.find(session);
    if (known == names_.end()) {
      const StatusOr<SessionRecord> record = reader_.GetSession(session);
      if (!record.ok() && !absl::IsNotFound(record.status())) return record.status();
      known = names_.emplace(session, record.ok() ? record->device : "").first;
    }
    return known->second;
  }

 private:
  MapReader& reader_;
  std::map<SessionId, std::string> names_;
};

/// Adds the revision before those of `run`, if it is of the same kind.
bool Prepend(const RevisionRecord& revision, RevisionRun& run) {
  if (revision.cause != run.cause || revision.session != run.session) return false;
  run.first = revision.revision;
  run.first_ns = revision.committed_ns;
  ++run.num_revisions;
  return true;
}

}  // namespace

StatusOr<Revision> ResolveRevision(MapReader& reader, const MapRecord& map, const std::string& at) {
  if (at.empty()) return map.revision;
  if (const std::optional<uint64_t> number = ParseNumber(at)) return Revision(*number);
  MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, reader.ListTags(map.id));
  const auto tag = std::ranges::find(tags, at, &TagRecord::name);
  if (tag != tags.end()) return tag->revision;
  return absl::NotFoundError(
      fmt::format("map \"{}\" has no tag \"{}\"; a revision is a number or a tag", map.name, at));
}

StatusOr<MapId> FindMap(MapStore& store, const std::string& name) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(name));
  return map.id;
}

StatusOr<std::unique_ptr<MapReader>> ReadMapAt(MapStore& store, const std::string& name, const std::string& at) {
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<MapReader> now, store.Read());
  if (at.empty()) return now;
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, now->FindMap(name));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ResolveRevision(*now, map, at));
  return store.ReadAsOf(map.id, revision);
}

StatusOr<RevisionLog> ReadRevisionLog(MapReader& reader, const std::string& map_name, size_t max_runs) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader.FindMap(map_name));
  RevisionLog log;
  log.oldest = map.oldest_revision;
  MAPP_ASSIGN_OR_RETURN(log.tags, reader.ListTags(map.id));
  Devices devices(reader);
  for (uint64_t last = map.revision.value(); last > 0 && !log.truncated;) {
    const uint64_t first = last > kRevisionsAtATime ? last - kRevisionsAtATime + 1 : 1;
    MAPP_ASSIGN_OR_RETURN(std::vector<RevisionRecord> revisions,
                          reader.ListRevisions(map.id, Revision(first), Revision(last)));
    std::ranges::reverse(revisions);
    for (const RevisionRecord& revision : revisions) {
      if (!log.runs.empty() && Prepend(revision, log.runs.back())) continue;
      if (log.runs.size() == max_runs) {
        log.truncated = true;
        break;
      }
      RevisionRun run{
          .first = {}, .last = revision.revision, .cause = revision.cause, .session = revision.session, .device = {}};
      run.last_ns = revision.committed_ns;
      if (run.session) {
        MAPP_ASSIGN_OR_RETURN(run.device, devices.NameOf(*run.session));
      }
      Prepend(revision, run);
      log.runs.push_back(std::move(run));
    }
    last = first - 1;
  }
  return log;
}

StatusOr<MapDiff> ReadMapDiff(MapReader& reader, const std::string& map_name, const std::string& from,
                              const std::string& to) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader.FindMap(map_name));
  MapDiff diff;
  MAPP_ASSIGN_OR_RETURN(diff.from, ResolveRevision(reader, map, from));
  MAPP_ASSIGN_OR_RETURN(diff.to, ResolveRevision(reader, map, to));
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionDiff> sessions, reader.DiffRevisions(map.id, diff.from, diff.to));
  Devices devices(reader);
  for (const SessionDiff& counts : sessions) {
    MAPP_ASSIGN_OR_RETURN(std::string device, devices.NameOf(counts.session));
    diff.sessions.push_back({counts, std::move(device)});
  }
  return diff;
}

}  // namespace mapp
