#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/map/keyframe.h"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace mapp {

/// What one view says of a map point that it should have seen.
enum class SurfaceSighting : uint8_t {
  kUnknown = 0,  ///< something nearer may hide it, or it cannot be told
  kSeen = 1,     ///< there is a surface where it lies
  kMissed = 2,   ///< the ray to it goes on to surfaces beyond
  kEmpty = 3,    ///< nothing at all was measured around the ray
};

/// Thresholds in scaled coordinates (view/sampler.h) are shares of the depth.
struct SightingOptions {
  /// An own point within this radius shows that the surface is there: 6 % of the depth to the side, 12 % along the ray.
  /// Source: the least sampling radius of the OVERLAP study.
  float match_radius = 0.06F;
  /// Own points within this lateral share of the depth tell how far the ray goes (42 px at a focal length of 525 px).
  /// Smaller leaves more undecided, larger mixes surfaces.
  float ray_radius = 0.08F;
};

/// Where one view has measured surfaces: the geometry of its own points, whatever they look like. What it says of a
/// place rests on that alone: a point that the detector merely did not pick counts as seen as long as something was
/// detected near it. Immutable.
class SeenGeometry {
 public:
  /// `p_camera`: own points, metres, z > 0.
  explicit SeenGeometry(std::vector<Eigen::Vector3f> p_camera, const SightingOptions& options = {});

  /// Of a place in front of the camera, metres. kMissed: of the three own points next to its ray at least two lie
  /// beyond it by more than the match radius, and none before it.
  SurfaceSighting At(const Eigen::Vector3f& p_camera) const;

  const std::vector<Eigen::Vector3f>& points() const { return p_camera_; }
  float farthest_depth_m() const { return farthest_depth_m_; }

 private:
  struct Entry {
    float x, y;  ///< x/z, y/z
    float half_ln_z;
    float z;
  };

  template <typename Visit>
  void VisitNear(float x, float y, float radius, const Visit& visit) const;

  SightingOptions options_;
  std::vector<Eigen::Vector3f> p_camera_;
  float farthest_depth_m_ = 0;
  // Cells of ray_radius over (x/z, y/z); entries of a cell lie together.
  float min_x_ = 0, min_y_ = 0;
  int num_cols_ = 0, num_rows_ = 0;
  std::vector<uint32_t> cell_begin_;
  std::vector<Entry> entries_;
};

/// The keyframe's features that have a depth, in its camera's frame; depths and so the points are multiplied by `scale`
/// (of sessions without metres, SessionRecord::scale_map_session).
std::vector<Eigen::Vector3f> OwnFeaturePoints(const Keyframe& keyframe, const Camera& camera, double scale = 1);
/// These, and the squares of its raster that hold none of them.
std::vector<Eigen::Vector3f> OwnSurfacePoints(const Keyframe& keyframe, const Camera& camera, double scale = 1);

}  // namespace mapp
