#pragma once

#include "bundle/bundle_file.h"
#include "bundle/bundle_writer.h"
#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/records.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace mapp {

class MapReader;
class MapStore;

/// Told of the frames written so far, and of how many there are.
using BundleExportObserver = std::function<void(uint64_t frames_done, uint64_t frames_total)>;

/// Writes the map as the reader has it, with its open sessions closed at `now_ns` (Unix time). What is observed and no
/// longer lives is left out. Needs the memory of the largest session's points and 24 bytes a point. Errors are the
/// reader's, the sink's and `context`'s.
Status ExportBundle(const CallContext& context, MapReader& reader, const MapRecord& map, int64_t now_ns, ByteSink sink,
                    const BundleExportObserver& on_progress);

/// How far an import is.
struct BundleImportProgress {
  bool writing = false;  ///< the bundle has been checked, and is written to the database
  uint64_t bytes_done = 0;
  uint64_t bytes_total = 0;
};
using BundleImportObserver = std::function<void(const BundleImportProgress&)>;

struct ImportedMap {
  MapRecord map;
  BundleCounts counts;
  std::vector<SessionId> owed;  ///< sessions whose optimisation is still owed
};

/// ALREADY_EXISTS, with what to do, when there is a map of that name.
Status CheckNameIsFree(MapReader& reader, const std::string& name);

/// Makes a map of the bundle, under the bundle's own name when `name` is empty: first all of it is checked, then all of
/// it is written in one change, so that there is the whole map or none; other changes wait for that one. Everything
/// gets numbers of this store, in packets too, and stands in the map's one revision, of the cause kImport.
/// `on_progress` is called on the store's thread while writing: it must not block. Needs 16 bytes a point and a frame.
///   ALREADY_EXISTS       a map of that name
///   DATA_LOSS            the bundle is cut short, damaged, or says what cannot be
///   FAILED_PRECONDITION  the bundle is of a format that this program does not know
///   INVALID_ARGUMENT     not a bundle; a name or feature settings that this server takes no maps of
/// and those of MapStore::Write.
StatusOr<ImportedMap> ImportBundle(const CallContext& context, MapStore& store, BundleFile& bundle,
                                   const std::string& name, const BundleImportObserver& on_progress);

}  // namespace mapp
