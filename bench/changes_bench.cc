// How long detection looks through a map's history: all of it but the last session, then after that one session more,
// then once more with nothing new.
//   changes_bench DATABASE MAP
// Of the database it changes only what single sessions tell (findings), which is made again; no server may have it
// open.
#include "bench/value_or_exit.h"
#include "mapp/base/latency.h"
#include "server/changes/change_scan.h"
#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {
namespace {

double Scan(std::string_view what, MapStore& store, const std::string& map_name, int64_t to_ns, ThingMemory& memory) {
  ScanOptions options;
  options.derivation.to_ns = to_ns;
  const Stopwatch watch;
  const ChangeScan scan = ValueOrExit(ScanForChanges(CallContext::WithTimeout(std::chrono::hours(1)), store, map_name,
                                                     options, memory, /*on_progress=*/{}),
                                      "scan");
  const double seconds = std::chrono::duration<double>(watch.Elapsed()).count();
  fmt::print("{:<24} {:8.2f} s  {} sessions, {} read, {} changes\n", what, seconds, scan.num_sessions,
             scan.num_sessions_read, scan.changes.size());
  return seconds;
}

void Run(const std::string& database, const std::string& map_name) {
  const auto store = ValueOrExit(OpenSqliteMapStore(database, {}), "database");
  MapRecord map;
  std::vector<SessionRecord> sessions;
  {
    const auto reader = ValueOrExit(store->Read());
    map = ValueOrExit(reader->FindMap(map_name), "map");
    sessions = ValueOrExit(reader->ListSessions(map.id));
    const std::vector<FrameRecord> frames = ValueOrExit(reader->ListFrames(map.id, std::nullopt));
    std::erase_if(sessions, [&](const SessionRecord& session) {
      return std::ranges::none_of(frames, [&](const FrameRecord& frame) { return frame.session == session.id; });
    });
    int64_t num_points = 0;
    for (const TileRecord& tile : ValueOrExit(reader->ListTiles(map.id, std::nullopt))) num_points += tile.num_points;
    fmt::print("{} sessions, {} keyframes, {} points\n", sessions.size(), frames.size(), num_points);
  }
  if (sessions.size() < 2) {
    fmt::print(stderr, "changes_bench: map \"{}\" needs two sessions with keyframes\n", map_name);
    std::exit(1);
  }
  OkOrExit(store->Write({}, [&](MapWriter& writer) { return writer.DropFindings(map.id); }));
  std::ranges::sort(sessions, {}, &SessionRecord::opened_ns);
  ThingMemory memory;
  const double all_s = Scan("all but one session", *store, map_name, sessions.back().opened_ns - 1, memory);
  const double more_s = Scan("one session more", *store, map_name, std::numeric_limits<int64_t>::max(), memory);
  Scan("nothing new", *store, map_name, std::numeric_limits<int64_t>::max(), memory);
  fmt::print("one more over all: {:.3f}\n", more_s / all_s);
}

}  // namespace
}  // namespace mapp

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print(stderr, "usage: changes_bench DATABASE MAP\n");
    return 2;
  }
  mapp::Run(argv[1], argv[2]);
}
