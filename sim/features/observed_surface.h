#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "sim/features/feature_world.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <vector>

namespace mapp::sim {

/// Surfaces seen more obliquely than this show no corners that could be told apart (78 degrees).
inline constexpr double kMinViewCosine = 0.2;

/// Flatter than this a surface shows not even its outline.
inline constexpr double kMinRimCosine = 0.03;
/// A surface shorter than this in pixels of an octave has no corners of its outline there.
inline constexpr double kMinOutlineEdge_px = 4;

/// What of a surface may be in the image.
struct SurfaceSight {
  bool corners = false;  ///< of its picture
  bool outline = false;
};

/// A camera at a place, with what culling needs.
struct FeatureView {
  FeatureView(const Camera& camera, const Pose3& T_world_camera);

  const Camera& camera;
  Pose3 T_world_camera;
  Pose3 T_camera_world;
  Eigen::Matrix3d R_camera_world;
  Eigen::Vector3d InCamera(const Eigen::Vector3d& p_world) const {
    return R_camera_world * p_world + T_camera_world.translation();
  }
  SurfaceSight SightOf(const SurfaceBounds& bounds) const;
  bool MaySeeBall(const Eigen::Vector3d& center_camera, double radius_m) const;
  bool InPyramid(const Eigen::Vector3d& p_camera) const;

  double focal_px;             ///< geometric mean of both axes
  Eigen::Vector2d min_slopes;  ///< x/z and y/z over the image
  Eigen::Vector2d max_slopes;

 private:
  std::array<Eigen::Vector3d, 4> side_normals_camera_;  ///< of the view's pyramid, inwards
  std::array<Eigen::Vector3f, 4> side_normals_world_;
};

/// A landmark that would be in the image if nothing hid it.
struct FeatureCandidate {
  const FeatureSurface* surface = nullptr;
  const TextureCorner* corner = nullptr;
  const OutlineCorner* outline = nullptr;  ///< whose look `corner` is, if it is one of an outline
  int size_step = 0;         ///< outlines: of the octave's pixels where they show it, in steps of the pyramid
  uint64_t landmark = 0;     ///< of this corner at this place of this surface; never 0
  Eigen::Vector2d fraction;  ///< place on the surface, in [0, 1]^2
  Eigen::Vector3d p_camera;  ///< metres
  Eigen::Vector2d pixel;     ///< exact
  int octave = 0;            ///< whose pixels are about as large as those the corner was found with
  double scale_misfit = 0;   ///< in octaves, [-0.5, 0.5]: how much larger the corner appears than at its best
  double view_cosine = 1;    ///< of the angle between the line of sight and the surface's normal
  double response = 0;       ///< contrast in gray levels, as lit and foreshortened
};

inline constexpr double kLogPyramidScale = 0.1823215567939546;  ///< ln kPyramidScale
inline constexpr double kNearest_m = 0.1;                       ///< nearer things are not seen
/// Contrast in gray levels below which nothing is a corner: the extractor's lower threshold.
inline constexpr double kMinResponse = 7;

/// Appends the surface's landmarks within the image, `border_px` pixels of their octave away from its edge.
void FindCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                    std::vector<FeatureCandidate>& candidates);

}  // namespace mapp::sim
