#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"

#include <memory>
#include <string>
#include <vector>

namespace mapp {

class MapReader;
class MapStore;

/// A map, and its tiles, at one revision.
struct MapState {
  MapRecord record;
  std::vector<TileRecord> tiles;
};

/// Revisions one after the other that have the same cause and session: a thousand keyframes are one line of a log.
struct RevisionRun {
  Revision first, last;
  uint64_t num_revisions = 0;
  int64_t first_ns = 0, last_ns = 0;  ///< Unix time
  RevisionCause cause = RevisionCause::kUnknown;
  std::optional<SessionId> session;
  std::string device;  ///< of the session; empty without one
};

struct RevisionLog {
  std::vector<RevisionRun> runs;  ///< newest first
  bool truncated = false;         ///< there are older ones
  Revision oldest;                ///< that can still be read
  std::vector<TagRecord> tags;
};

struct MapDiff {
  struct Session {
    SessionDiff counts;
    std::string device;
  };
  Revision from, to;
  std::vector<Session> sessions;
};

/// What an operator names by `at`: the number of a revision, a tag, or nothing for the present. NOT_FOUND: no such tag.
/// A number is not checked.
StatusOr<Revision> ResolveRevision(MapReader& reader, const MapRecord& map, const std::string& at);
/// NOT_FOUND: no such map.
StatusOr<MapId> FindMap(MapStore& store, const std::string& name);
/// A reader of the present, or of the map AS OF what `at` names. Errors as ResolveRevision and MapStore::ReadAsOf.
StatusOr<std::unique_ptr<MapReader>> ReadMapAt(MapStore& store, const std::string& name, const std::string& at);

StatusOr<RevisionLog> ReadRevisionLog(MapReader& reader, const std::string& map_name, size_t max_runs);
StatusOr<MapDiff> ReadMapDiff(MapReader& reader, const std::string& map_name, const std::string& from,
                              const std::string& to);

}  // namespace mapp
