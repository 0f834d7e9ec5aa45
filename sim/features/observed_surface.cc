#include "sim/features/observed_surface.h"

#include "sim/features/hash.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace mapp::sim {
namespace {

/// Nearer to the surface's edge than this, in pixels of its level, a corner's patch shows mostly what is behind.
constexpr double kEdgePixels = 5;
/// Octaves [0, kPyramidLevels), each from half a step below to half a step above.
constexpr double kMinOctave = -0.5;
constexpr double kMaxOctave = kPyramidLevels - 0.5;
const double kMinPixels = std::exp(kMinOctave * kLogPyramidScale);
const double kMaxPixels = std::exp(kMaxOctave * kLogPyramidScale);
/// Of the distances at which a level serves: the nearest to the farthest, and those of the next level.
const double kClosestShare = std::pow(kMinPixels / kMaxPixels, 2.0 / 3.0);
const double kFartherPerLevel = std::exp(kLogPyramidScale * 2 / 3);
/// Texels may be so much longer than wide before their picture is drawn anew; see kAspectStep in feature_world.cc.
constexpr double kTexelStretch = 1.06;

/// Places on a surface, as fractions of its edges.
using FractionBox = Eigen::AlignedBox2d;

/// The part of the surface that lies in the view's pyramid, from `min_depth_m` on: the bounding box of its outline.
FractionBox VisiblePart(const Eigen::Vector3d& c, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                        const FeatureView& view) {
  // Half-spaces n . p >= d in the camera's frame.
  const std::array<Eigen::Vector4d, 5> planes = {
      Eigen::Vector4d(0, 0, 1, -kNearest_m), Eigen::Vector4d(1, 0, -view.min_slopes.x(), 0),
      Eigen::Vector4d(-1, 0, view.max_slopes.x(), 0), Eigen::Vector4d(0, 1, -view.min_slopes.y(), 0),
      Eigen::Vector4d(0, -1, view.max_slopes.y(), 0)};
  constexpr size_t kMaxCorners = 4 + 5;
  std::array<Eigen::Vector2d, kMaxCorners> outline{Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0), Eigen::Vector2d(1, 1),
                                                   Eigen::Vector2d(0, 1)};
  size_t size = 4;
  for (const Eigen::Vector4d& plane : planes) {
    const auto inside = [&](const Eigen::Vector2d& at) {
      return plane.head<3>().dot(c + at.x() * u + at.y() * v) + plane.w();
    };
    std::array<Eigen::Vector2d, kMaxCorners> clipped;
    size_t num_clipped = 0;
    for (size_t i = 0; i < size; ++i) {
      const Eigen::Vector2d& from = outline[i];
      const Eigen::Vector2d& to = outline[(i + 1) % size];
      const double at_from = inside(from);
      const double at_to = inside(to);
      if (at_from >= 0 && num_clipped < kMaxCorners) clipped[num_clipped++] = from;
      if ((at_from >= 0) != (at_to >= 0) && num_clipped < kMaxCorners) {
        clipped[num_clipped++] = from + at_from / (at_from - at_to) * (to - from);
      }
    }
    outline = clipped;
    size = num_clipped;
    if (size == 0) break;
  }
  FractionBox box;
  for (size_t i = 0; i < size; ++i) box.extend(outline[i]);
  return box;
}

/// Walks one surface's corners level by level.
class SurfaceWalk {
 public:
  SurfaceWalk(const FeatureSurface& surface, const FeatureView& view, double border_px,
              std::vector<FeatureCandidate>& candidates)
      : surface_(surface), view_(view), border_px_(border_px), candidates_(candidates) {
    c_ = view.InCamera(surface.corner_world);
    u_ = view.R_camera_world * surface.edge_u_world;
    v_ = view.R_camera_world * surface.edge_v_world;
  }

  void Run() {
    height_m_ = surface_.normal_world.dot(view_.T_world_camera.translation() - surface_.corner_world);
    if (height_m_ < kNearest_m * kMinViewCosine) return;
    visible_ = VisiblePart(c_, u_, v_, view_);
    if (visible_.isEmpty()) return;
    // The place below the camera, in fractions, and the farthest distance at which the surface is not too oblique.
    foot_ = {-c_.dot(u_) / u_.squaredNorm(), -c_.dot(v_) / v_.squaredNorm()};
    const double reach_m = height_m_ / kMinViewCosine;
    visible_ = visible_.intersection(Disc(reach_m));
    if (visible_.isEmpty()) return;
    const TextureCorners& corners = *surface_.picture;
    texel_m_ = std::sqrt(surface_.length_u_m / (surface_.span.x() * corners.width_texels()) * surface_.length_v_m /
                         (surface_.span.y() * corners.height_texels()));
    const Eigen::Vector2d nearest = foot_.cwiseMax(visible_.min()).cwiseMin(visible_.max());
    const double nearest_m = At(nearest).norm();
    const double constant = view_.focal_px * texel_m_ * std::sqrt(height_m_);
    double farthest_m = std::cbrt(constant * constant / (kMinPixels * kMinPixels));
    for (size_t level = 0; level < corners.levels().size(); ++level) {
      if (farthest_m >= nearest_m) WalkLevel(corners, level, farthest_m);
      farthest_m *= kFartherPerLevel;
    }
  }

 private:
  Eigen::Vector3d At(const Eigen::Vector2d& fraction) const { return c_ + fraction.x() * u_ + fraction.y() * v_; }

  /// Bounds of the places within `distance_m` of the camera.
  FractionBox Disc(double distance_m) const {
    const double radius_m = std::sqrt(std::max(0.0, distance_m * distance_m - height_m_ * height_m_));
    const Eigen::Vector2d half(radius_m / surface_.length_u_m, radius_m / surface_.length_v_m);
    return {foot_ - half, foot_ + half};
  }

  /// `focal * pitch * sqrt(cosine) / distance` pixels is how large a pixel of the level appears; its logarithm to the
  /// pyramid's base is the octave. With cosine = height / distance it falls with distance^1.5, so that a level serves a
  /// ring around the foot.
  void WalkLevel(const TextureCorners& corners, size_t level_idx, double farthest_m) {
    const double closest_m = farthest_m * kClosestShare;
    if (farthest_m < height_m_) return;
    const FractionBox box = visible_.intersection(Disc(farthest_m));
    if (box.isEmpty()) return;
    for (const Eigen::Vector2d& end : {box.min(), box.max(), Eigen::Vector2d(box.min().x(), box.max().y()),
                                       Eigen::Vector2d(box.max().x(), box.min().y())}) {
      if (At(end).norm() < closest_m) continue;
      WalkCells(corners, level_idx, box);
      return;
    }
  }

  void WalkCells(const TextureCorners& corners, size_t level_idx, const FractionBox& box) {
    const CornerLevel& level = corners.levels()[level_idx];
    const Eigen::Vector2d size(corners.width_texels(), corners.height_texels());
    // Texels count on through the picture's repetitions.
    const Eigen::Vector2d from = (surface_.start + box.min().cwiseProduct(surface_.span)).cwiseProduct(size);
    const Eigen::Vector2d to = (surface_.start + box.max().cwiseProduct(surface_.span)).cwiseProduct(size);
    for (auto repeat_y = static_cast<int>(std::floor(from.y() / size.y())); repeat_y * size.y() <= to.y(); ++repeat_y) {
      const auto [first_row, last_row] =
          Cells(from.y() - repeat_y * size.y(), to.y() - repeat_y * size.y(), level.cell_texels(), level.rows());
      for (auto repeat_x = static_cast<int>(std::floor(from.x() / size.x())); repeat_x * size.x() <= to.x();
           ++repeat_x) {
        const auto [first_column, last_column] =
            Cells(from.x() - repeat_x * size.x(), to.x() - repeat_x * size.x(), level.cell_texels(), level.columns());
        for (int row = first_row; row <= last_row; ++row) {
          for (int column = first_column; column <= last_column; ++column) {
            WalkCell(corners, level_idx, row * level.columns() + column, {repeat_x, repeat_y});
          }
        }
      }
    }
  }

  static std::pair<int, int> Cells(double from_texels, double to_texels, double cell_texels, int count) {
    return {std::clamp(static_cast<int>(std::floor(from_texels / cell_texels)), 0, count),
            std::clamp(static_cast<int>(std::floor(to_texels / cell_texels)), -1, count - 1)};
  }

  /// Whether a part of the surface may be near enough, and far enough, for some of the level's corners to be seen.
  bool MayServe(const CornerLevel& level, const Eigen::Vector3d& middle_camera, double radius_m) const {
    const double distance_m = middle_camera.norm();
    const double nearest_m = std::max(distance_m - radius_m, height_m_);
    const double farthest_m = distance_m + radius_m;
    if (nearest_m * kMinViewCosine > height_m_) return false;
    const double pixels_at_1m = PixelsAt1m(level);
    return pixels_at_1m >= kMinPixels * nearest_m * std::sqrt(nearest_m) &&
           pixels_at_1m < kMaxPixels * farthest_m * std::sqrt(farthest_m);
  }

  /// Size at which a pixel of the level would appear at a place 1 m away, squeezed as it lies.
  double PixelsAt1m(const CornerLevel& level) const {
    return view_.focal_px * level.pitch_texels() * texel_m_ * std::sqrt(height_m_);
  }

  void WalkCell(const TextureCorners& corners, size_t level_idx, int cell, const Eigen::Vector2i& repeat) {
    const CornerLevel& level = corners.levels()[level_idx];
    // fraction = texels * per_texel + offset
    const Eigen::Vector2d size(corners.width_texels(), corners.height_texels());
    const Eigen::Vector2d per_texel = (size.cwiseProduct(surface_.span)).cwiseInverse();
    const Eigen::Vector2d offset = (repeat.cast<double>() - surface_.start).cwiseQuotient(surface_.span);
    const Eigen::Vector2d middle_texels =
        level.cell_texels() * Eigen::Vector2d(cell % level.columns() + 0.5, cell / level.columns() + 0.5);
    const double radius_m = level.cell_texels() * texel_m_ * std::numbers::sqrt2 / 2 * kTexelStretch;
    const Eigen::Vector3d middle_camera = At(middle_texels.cwiseProduct(per_texel) + offset);
    if (!MayServe(level, middle_camera, radius_m) || !view_.MaySeeBall(middle_camera, radius_m)) return;
    const std::span<const TextureCorner> in_cell = level.Cell(cell % level.columns(), cell / level.columns());
    const double edge_m = kEdgePixels * level.pitch_texels() * texel_m_;
    const Eigen::Vector2d margin(edge_m / surface_.length_u_m, edge_m / surface_.length_v_m);
    const double pixels_at_1m = PixelsAt1m(level);
    if (in_cell.empty()) return;
    const uint64_t level_at = Hash(surface_.id, level_idx, static_cast<uint64_t>(cell));
    const uint64_t cell_id = Hash(level_at, static_cast<uint32_t>(repeat.x()), static_cast<uint32_t>(repeat.y()));
    for (size_t i = 0; i < in_cell.size(); ++i) {
      const TextureCorner& corner = in_cell[i];
      const Eigen::Vector2d fraction =
          Eigen::Vector2d(corner.x_texels, corner.y_texels).cwiseProduct(per_texel) + offset;
      if ((fraction.array() < margin.array()).any() || (fraction.array() > 1 - margin.array()).any()) continue;
      if (!TryCorner(corner, fraction, pixels_at_1m)) continue;
      candidates_.back().landmark = Hash(cell_id, i) | 1U;
    }
  }

  /// `pixels_at_1m`: the size at which a pixel of the corner's level would appear 1 m away, seen from straight ahead.
  bool TryCorner(const TextureCorner& corner, const Eigen::Vector2d& fraction, double pixels_at_1m) {
    const Eigen::Vector3d p_camera = At(fraction);
    if (p_camera.z() < kNearest_m || !view_.InPyramid(p_camera)) return false;
    const double distance_m = p_camera.norm();
    const double cosine = height_m_ / distance_m;
    if (cosine < kMinViewCosine) return false;
    const double pixels = pixels_at_1m / (distance_m * std::sqrt(distance_m));
    if (pixels < kMinPixels || pixels >= kMaxPixels) return false;
    // Squeezing a picture to cos of its width blurs its contrasts along: by the fourth root.
    const double contrast =
        static_cast<double>(corner.response) * surface_.Light(fraction) * std::sqrt(std::sqrt(cosine));
    if (contrast < kMinResponse) return false;
    const double octave = std::log(pixels) / kLogPyramidScale;
    const int nearest_octave = std::clamp(static_cast<int>(octave + 0.5), 0, kPyramidLevels - 1);
    const Eigen::Vector2d pixel = view_.camera.Project(p_camera);
    if (!view_.camera.Contains(pixel, border_px_ * static_cast<double>(OctaveScale(nearest_octave)))) return false;
    FeatureCandidate& candidate = candidates_.emplace_back();
    candidate.surface = &surface_;
    candidate.corner = &corner;
    candidate.fraction = fraction;
    candidate.p_camera = p_camera;
    candidate.pixel = pixel;
    candidate.octave = nearest_octave;
    candidate.scale_misfit = octave - nearest_octave;
    candidate.view_cosine = cosine;
    candidate.response = contrast;
    return true;
  }

  const FeatureSurface& surface_;
  const FeatureView& view_;
  double border_px_;
  std::vector<FeatureCandidate>& candidates_;
  Eigen::Vector3d c_, u_, v_;  ///< the surface's corner and edges in the camera's frame
  double height_m_ = 0;        ///< of the camera above the surface's plane
  double texel_m_ = 0;
  Eigen::Vector2d foot_;
  FractionBox visible_;
};

}  // namespace

FeatureView::FeatureView(const Camera& with_camera, const Pose3& at)
    : camera(with_camera),
      T_world_camera(at),
      T_camera_world(at.Inverse()),
      R_camera_world(T_camera_world.RotationMatrix()) {
  focal_px = std::sqrt(camera.FocalLengths().prod());
  min_slopes = max_slopes = camera.Unproject(camera.PrincipalPoint()).head<2>();
  constexpr int kStepsAlongEdge = 8;
  for (int i = 0; i <= kStepsAlongEdge; ++i) {
    const double x = static_cast<double>(camera.width_px - 1) * i / kStepsAlongEdge;
    const double y = static_cast<double>(camera.height_px - 1) * i / kStepsAlongEdge;
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(x, 0), Eigen::Vector2d(x, camera.height_px - 1),
                                         Eigen::Vector2d(0, y), Eigen::Vector2d(camera.width_px - 1, y)}) {
      const Eigen::Vector2d slopes = camera.Unproject(pixel).head<2>();
      min_slopes = min_slopes.cwiseMin(slopes);
      max_slopes = max_slopes.cwiseMax(slopes);
    }
  }
  const std::array<Eigen::Vector3d, 4> normals_camera = {
      Eigen::Vector3d(1, 0, -min_slopes.x()), Eigen::Vector3d(-1, 0, max_slopes.x()),
      Eigen::Vector3d(0, 1, -min_slopes.y()), Eigen::Vector3d(0, -1, max_slopes.y())};
  for (size_t i = 0; i < normals_camera.size(); ++i) {
    side_normals_camera_[i] = normals_camera[i].normalized();
    side_normals_world_[i] = (T_world_camera.rotation() * side_normals_camera_[i]).cast<float>();
  }
}

bool FeatureView::InPyramid(const Eigen::Vector3d& p_camera) const {
  const Eigen::Vector2d min = p_camera.z() * min_slopes;
  const Eigen::Vector2d max = p_camera.z() * max_slopes;
  return p_camera.x() >= min.x() && p_camera.x() <= max.x() && p_camera.y() >= min.y() && p_camera.y() <= max.y();
}

bool FeatureView::MaySeeBall(const Eigen::Vector3d& center_camera, double radius_m) const {
  return std::all_of(side_normals_camera_.begin(), side_normals_camera_.end(),
                     [&](const Eigen::Vector3d& normal) { return normal.dot(center_camera) >= -radius_m; });
}

SurfaceSight FeatureView::SightOf(const SurfaceBounds& bounds) const {
  const Eigen::Vector3f eye_world = T_world_camera.translation().cast<float>();
  const float height_m = bounds.normal_world.dot(eye_world) - bounds.plane_offset_m;
  if (height_m <= 0) return {};
  const Eigen::Vector3f to_center = bounds.center_world - eye_world;
  for (const Eigen::Vector3f& normal_world : side_normals_world_) {
    if (normal_world.dot(to_center) < -bounds.radius_m) return {};
  }
  const float nearest_m = to_center.norm() - bounds.radius_m;
  // Most of what is in view is too far away for all but a flat look at it.
  return {.corners = nearest_m * static_cast<float>(kMinViewCosine) <= height_m,
          .outline = bounds.has_outline && nearest_m * static_cast<float>(kMinRimCosine) <= height_m &&
                     nearest_m * static_cast<float>(kMinOutlineEdge_px) <=
                         bounds.shorter_edge_m * static_cast<float>(focal_px)};
}

void FindCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                    std::vector<FeatureCandidate>& candidates) {
  SurfaceWalk(surface, view, border_px, candidates).Run();
}

}  // namespace mapp::sim
