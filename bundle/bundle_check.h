#pragma once

#include "bundle/bundle_reader.h"
#include "bundle/id_table.h"
#include "mapp/base/call_context.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>

namespace mapp {

/// What stands in a bundle that has been read to its end.
struct BundleSummary {
  BundleMap map;
  BundleCounts counts;
  uint64_t num_bytes = 0;
};

/// Whether records, taken in their order, make a map that a server can serve: every id that is named is there, every
/// value possible, every keyframe one that its device could have uploaded. Needs 16 bytes a point.
class BundleChecker {
 public:
  /// DATA_LOSS: what is wrong with the record, or with those before it as its kind shows.
  Status Take(const BundleRecord& record);
  /// After the last one.
  Status Finish();
  const BundleMap& map() const { return *map_; }

 private:
  Status Check(const BundleMap& record);
  Status Check(const CameraRecord& record);
  Status Check(const SessionRecord& session);
  Status Check(const PointRecord& point);
  Status Check(const BundleFrame& frame);
  Status Check(const PointObservers& observers);
  Status Check(const FusedPoint& fused);
  Status Check(const BundleTag& tag);
  Status CheckObservations(const BundleFrame& frame, size_t num_features) const;

  uint8_t last_kind_ = 0;
  std::optional<BundleMap> map_;
  std::unordered_map<CameraId, Camera> cameras_;
  struct KnownSession {
    CameraId camera;
    bool is_aligned = false;
  };
  std::unordered_map<SessionId, KnownSession> sessions_;
  std::set<std::pair<SessionId, uint32_t>> keyframes_;
  IdTable points_;
  IdTable frames_;
  IdTable observed_;
};

/// Reads a whole bundle and checks all of it. Tells `on_progress` (may be empty) of the bytes read. Errors are
/// BundleReader's and BundleChecker's; CANCELLED or DEADLINE_EXCEEDED of `context`.
StatusOr<BundleSummary> CheckBundle(const CallContext& context, ByteSource source,
                                    const std::function<void(uint64_t bytes_done)>& on_progress);

}  // namespace mapp
