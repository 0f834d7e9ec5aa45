#pragma once

#include "bundle/bundle_reader.h"
#include "bundle/bundle_writer.h"
#include "server/service/map_bundle.h"
#include "tests/unit/storage/store_fixture.h"

#include <string>
#include <vector>

namespace mapp::testing {

/// Of the map of this name, now or AS OF `at`, at a time of no importance.
std::string ExportToString(MapStore& store, const std::string& name, const std::string& at = {});
StatusOr<ImportedMap> ImportFromString(MapStore& store, const std::string& bundle, const std::string& name = {},
                                       const CallContext& context = {}, const BundleImportObserver& on_progress = {});

ByteSource SourceOf(const std::string& bytes);
StatusOr<std::vector<BundleRecord>> ReadRecords(const std::string& bundle);
std::string WriteRecords(const std::vector<BundleRecord>& records);

/// Everything a reader tells of two maps is the same, but for the numbers of this store or that, tile revisions and
/// blobs, place blocks, counters of bytes and history.
void ExpectSameMap(MapReader& a, const MapRecord& map_a, MapReader& b, const MapRecord& map_b);

/// A store with the map "cell": two small keyframes, four points, one of which has been fused into another.
class SmallMap {
 public:
  SmallMap();
  MapStore& store() { return *store_; }
  const std::string& bundle() const { return bundle_; }
  std::vector<BundleRecord> records() const { return Value(ReadRecords(bundle_)); }

 private:
  std::unique_ptr<MapStore> store_;
  std::string bundle_;
};

}  // namespace mapp::testing
