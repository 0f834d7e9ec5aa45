#pragma once

#include "storage/records.h"

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

// What a bundle holds, in this order. Ids are those of the server that it comes from.

/// The first record. Of `map` the counters, id and oldest revision are not carried.
struct BundleMap {
  MapRecord map;            ///< its revision is the one that was exported
  int64_t exported_ns = 0;  ///< Unix time
};

/// A frame with what its device sent: session, number, stamp, overlap and number of features are in the packet.
struct BundleFrame {
  FrameId id;
  bool in_map = false;
  Pose3 T_frame_camera;  ///< as FrameRecord's
  std::vector<Observation> observations;
  std::string packet;
};

/// PointRecord::observers, apart: a point comes before the frames that see it.
struct PointObservers {
  MapPointId point;
  std::vector<FrameId> frames;
};

/// The session's number stands for a point that was not made for it: what was has been fused into this one.
struct FusedPoint {
  SessionId session;
  uint64_t session_point = 0;
  MapPointId point;
};

/// A tag of the exported revision.
struct BundleTag {
  std::string name;
};

/// Of a SessionRecord the map and the counters are not carried, of `optimized` only whether there is one; of a
/// PointRecord neither `created` nor `observers`.
using BundleRecord = std::variant<BundleMap, CameraRecord, SessionRecord, PointRecord, BundleFrame, PointObservers,
                                  FusedPoint, BundleTag>;

/// How many of each there are.
struct BundleCounts {
  uint64_t cameras = 0;
  uint64_t sessions = 0;
  uint64_t points = 0;
  uint64_t frames = 0;
  uint64_t observers = 0;
  uint64_t fused = 0;
  uint64_t tags = 0;
  void Add(const BundleRecord& record);
  friend bool operator==(const BundleCounts&, const BundleCounts&) = default;
};

}  // namespace mapp
