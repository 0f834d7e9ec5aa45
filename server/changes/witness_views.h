#pragma once

#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/view/point_judge.h"
#include "storage/records.h"

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>

namespace mapp {

class MapReader;

/// A frame that stands in the map, as a witness of what was there.
struct WitnessView : MeasuredView {
  WitnessView(const FrameRecord& record, MeasuredView measured)
      : MeasuredView(std::move(measured)), frame(record.id), stamp_ns(record.stamp_ns) {}

  FrameId frame;
  int64_t stamp_ns = 0;  ///< by the device's clock
};

/// What frames of one map measured, read from the keyframe log when asked for; those used last are kept. Thread-safe.
class WitnessViews {
 public:
  /// Borrows the reader and the mutex under which it is asked.
  WitnessViews(MapReader& reader, Mutex& mutex, const MapRecord& map, size_t max_kept);

  StatusOr<std::shared_ptr<const WitnessView>> Get(const FrameRecord& frame, const SessionRecord& session);

 private:
  struct Packet {
    Camera camera;
    std::string bytes;
  };

  StatusOr<Packet> Read(const FrameRecord& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  using Kept = std::list<std::pair<FrameId, std::shared_ptr<const WitnessView>>>;

  Mutex& mutex_;
  MapReader& reader_ ABSL_GUARDED_BY(mutex_);
  const double range_m_;
  const size_t max_kept_;
  std::map<CameraId, Camera> cameras_ ABSL_GUARDED_BY(mutex_);
  Kept kept_ ABSL_GUARDED_BY(mutex_);  // used last first
  std::unordered_map<FrameId, Kept::iterator> index_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
