#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/view/seen_geometry.h"
#include "storage/records.h"

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <unordered_map>
#include <vector>

namespace mapp {

class MapReader;

/// A frame that stands in the map, as a witness: where it looked from, and where it measured surfaces.
struct WitnessView {
  WitnessView(const FrameRecord& record, const Camera& with_camera, double with_range_m, SeenGeometry with_geometry,
              bool is_complete);

  FrameId frame;
  int64_t stamp_ns = 0;  ///< by the device's clock
  Pose3 T_map_camera;
  Camera camera;
  double range_m = 0;  ///< h of the map
  bool complete =
      true;  ///< false: redundancy control has taken out what the map held, without a raster of it: it misses nothing
  SeenGeometry geometry;
  Aabb box_map;  ///< around all that it can tell of
};

/// What frames of one map measured, read from the keyframe log when asked for; those used last are kept.
class WitnessViews {
 public:
  /// Borrows the reader.
  WitnessViews(MapReader& reader, const MapRecord& map, size_t max_kept);

  StatusOr<std::shared_ptr<const WitnessView>> Get(const FrameRecord& frame, const SessionRecord& session);

 private:
  using Kept = std::list<std::pair<FrameId, std::shared_ptr<const WitnessView>>>;

  MapReader& reader_;
  const double range_m_;
  const size_t max_kept_;
  std::map<CameraId, Camera> cameras_;
  Kept kept_;  // used last first
  std::unordered_map<FrameId, Kept::iterator> index_;
};

}  // namespace mapp
