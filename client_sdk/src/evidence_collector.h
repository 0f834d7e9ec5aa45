#pragma once

#include "mapp/base/id.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"
#include "mapp/view/point_judge.h"
#include "shared_tiles.h"

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// What one report to the server holds.
struct EvidenceReport {
  uint32_t number = 0;  ///< counts the session's reports from 0
  std::string packet;   ///< codec/evidence_codec.h
};

/// Sums up over frames that were localised on shared maps which of the maps' points they saw where they should be and
/// which they missed: by the code that judges stored keyframes on the server (view/point_judge.h), so that it means the
/// same. All points are judged, as what is missing around a point decides, a sample of them is told. One thread only.
class EvidenceCollector {
 public:
  /// `range_m`: h of the map.
  EvidenceCollector(const Camera& camera, double range_m) : camera_(camera), range_m_(range_m) {}

  /// The shared map that frames are localised on from now on: its tiles, which `tiles` holds decoded, and the alignment
  /// that it was handed out with.
  void UseMap(uint32_t number, const std::vector<TileKey>& keys, const SharedTiles& tiles, const Pose3& T_map_session);
  /// Counts a whole keyframe of a frame localised on shared map `number`; its pose is T_session_camera. Frames of
  /// another map are passed over. A report is made of what has been counted over a minute of the device's clock: true
  /// when it was.
  bool Add(const Keyframe& view, uint32_t number);
  /// Makes a report of what has been counted since the last: the device leaves the map, or the session.
  void Conclude();

  /// Reports that the server has not taken yet, oldest first. Beyond some the oldest is dropped.
  bool has_reports() const { return !reports_.empty(); }
  const EvidenceReport& NextReport() const { return reports_.front(); }
  void DropNextReport() { reports_.pop_front(); }

 private:
  struct MapTile {
    Revision revision;
    Aabb box_map;
    SightedPoints points;
  };

  const Camera camera_;
  const double range_m_;
  uint32_t map_number_ = 0;
  Pose3 T_map_session_;
  std::map<TileKey, MapTile> tiles_;  ///< of the map in use
  std::optional<PointJudge> judge_;   ///< from the first view on
  int64_t first_stamp_ns_ = 0;        ///< of the judge's first view
  uint32_t next_number_ = 0;
  std::deque<EvidenceReport> reports_;
};

}  // namespace mapp
