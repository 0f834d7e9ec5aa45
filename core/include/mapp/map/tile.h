#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <array>
#include <compare>
#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

/// Cubic cell of the map, the unit of storage, caching and sharing. With edge e, the cell (x, y, z) holds the points
/// with floor(p / e) == (x, y, z).
struct TileKey {
  int32_t x = 0, y = 0, z = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;

  /// 21 bits an axis, biased by 2^20, x highest. Requires every index in [-2^20, 2^20).
  uint64_t Packed() const;
  static TileKey FromPacked(uint64_t packed);
  std::string ToString() const;  ///< "x/y/z"
};

inline constexpr double kDefaultTileEdgeM = 8.0;
/// Tiles are smaller than this, metres.
inline constexpr double kMaxTileEdgeM = 1000.0;

/// The tiling of one map.
struct TileGrid {
  double edge_m = kDefaultTileEdgeM;
  TileKey KeyOf(const Eigen::Vector3d& p_map) const;
  Aabb BoxOf(const TileKey& key) const;
};

/// A keyframe that saw points of a tile: enough to judge from where the points were seen.
struct TileFrame {
  FrameId id;
  Pose3 T_map_camera;
  float field_of_view = 0;  ///< radians
};

/// Focal length in pixels that stored reference distances are told for.
inline constexpr double kReferenceFocalPx = 500;
/// A stored reference distance as a camera of `focal_px` has it: a longer lens sees the same thing as large from
/// further away.
inline float ReferenceFor(double focal_px, float reference_distance_m) {
  return static_cast<float>(focal_px / kReferenceFocalPx) * reference_distance_m;
}

/// A map point as stored in a tile, sent to devices and cached by them.
struct TilePoint {
  static constexpr int kMaxObservers = 4;
  MapPointId id;
  Eigen::Vector3f p_map = Eigen::Vector3f::Zero();            ///< metres, quantised to edge / 65535 within the tile
  OrbDescriptor descriptor;                                   ///< representative: least median distance to the others
  Eigen::Vector3f view_direction = Eigen::Vector3f::UnitZ();  ///< unit, mean of (point - observing camera centre)
  /// Distance at which a camera of focal length kReferenceFocalPx would detect the point at octave 0, metres; octave o
  /// fits distance reference / 1.2^o. For other cameras see ReferenceFor().
  float reference_distance_m = 1;
  uint16_t num_observations = 0;
  float confidence = 1;  ///< probability in [0, 1] that the point is still there
  /// Indices into Tile::frames of up to kMaxObservers observers, chosen to differ most in direction.
  std::vector<uint16_t> observers;
};

struct Tile {
  TileKey key;
  double edge_m = kDefaultTileEdgeM;
  /// Revision of the last commit that changed the tile's content.
  Revision revision;
  std::vector<TileFrame> frames;
  std::vector<TilePoint> points;
};

/// All violations of a tile's invariants, one line each; empty when it is consistent.
std::vector<std::string> CheckConsistency(const Tile& tile);

}  // namespace mapp

template <>
struct std::hash<mapp::TileKey> {
  size_t operator()(const mapp::TileKey& key) const noexcept { return std::hash<uint64_t>{}(key.Packed()); }
};
