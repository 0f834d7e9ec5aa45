#include "eval/metrics/overlap_oracle.h"

#include "server/service/point_tree.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace mapp {
namespace {

/// Map points by where they appear in an image, in square cells.
class ImageGrid {
 public:
  ImageGrid(const Camera& camera, double cell_px)
      : cell_px_(cell_px),
        columns_(static_cast<int>(camera.width_px / cell_px) + 1),
        rows_(static_cast<int>(camera.height_px / cell_px) + 1),
        cells_(static_cast<size_t>(columns_ * rows_)) {}

  void Add(const Eigen::Vector2d& pixel, const OrbDescriptor& descriptor) {
    cells_[Index(Column(pixel.x()), Row(pixel.y()))].push_back({pixel, &descriptor});
  }
  /// Whether one within a cell's edge of `pixel` differs from `descriptor` in at most `max_hamming` bits.
  bool HasMatch(const Eigen::Vector2d& pixel, const OrbDescriptor& descriptor, int max_hamming) const {
    const int column = Column(pixel.x());
    const int row = Row(pixel.y());
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows_ - 1); ++r) {
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns_ - 1); ++c) {
        for (const Item& item : cells_[Index(c, r)]) {
          if ((item.pixel - pixel).squaredNorm() <= cell_px_ * cell_px_ &&
              HammingDistance(*item.descriptor, descriptor) <= max_hamming) {
            return true;
          }
        }
      }
    }
    return false;
  }

 private:
  struct Item {
    Eigen::Vector2d pixel;
    const OrbDescriptor* descriptor;
  };
  int Column(double u_px) const { return std::clamp(static_cast<int>(u_px / cell_px_), 0, columns_ - 1); }
  int Row(double v_px) const { return std::clamp(static_cast<int>(v_px / cell_px_), 0, rows_ - 1); }
  size_t Index(int column, int row) const { return static_cast<size_t>(row * columns_ + column); }

  double cell_px_;
  int columns_;
  int rows_;
  std::vector<std::vector<Item>> cells_;
};

bool IsSeenAlike(const SeenPoint& point, const Eigen::Vector3d& center_map, double cos_like_view) {
  const Eigen::Vector3d ray = (point.p_map - center_map).normalized();
  return std::ranges::any_of(point.observers_map, [&](const Eigen::Vector3d& observer_map) {
    return (point.p_map - observer_map).normalized().dot(ray) >= cos_like_view;
  });
}

}  // namespace

struct OverlapOracle::Impl {
  std::vector<SeenPoint> points;
  OracleRule rule;
  std::optional<PointTree> tree;  // none without points
};

OverlapOracle::OverlapOracle(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
OverlapOracle::~OverlapOracle() = default;

StatusOr<std::unique_ptr<OverlapOracle>> OverlapOracle::Create(std::vector<SeenPoint> points, const OracleRule& rule) {
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i].p_map.allFinite()) return absl::InvalidArgumentError(fmt::format("point {}: not finite", i));
    positions.push_back(points[i].p_map.cast<float>());
  }
  auto impl = std::make_unique<Impl>();
  impl->points = std::move(points);
  impl->rule = rule;
  if (!positions.empty()) {
    MAPP_ASSIGN_OR_RETURN(PointTree tree, PointTree::Build(positions));
    impl->tree = std::move(tree);
  }
  return std::unique_ptr<OverlapOracle>(new OverlapOracle(std::move(impl)));
}

std::vector<bool> OverlapOracle::KnownByGeometry(const Pose3& T_map_camera,
                                                 std::span<const Eigen::Vector3d> own_camera) const {
  std::vector<bool> known(own_camera.size());
  if (!impl_->tree) return known;
  const OracleRule& rule = impl_->rule;
  const double cos_like_view = std::cos(rule.like_view_angle);
  for (size_t i = 0; i < own_camera.size(); ++i) {
    const double reach_m = std::max(rule.min_reach_m, rule.reach_ratio * own_camera[i].z());
    const Eigen::Vector3d p_map = T_map_camera * own_camera[i];
    known[i] = impl_->tree->AnyWithin(p_map.cast<float>(), static_cast<float>(reach_m), [&](size_t idx) {
      return IsSeenAlike(impl_->points[idx], T_map_camera.translation(), cos_like_view);
    });
  }
  return known;
}

std::vector<bool> OverlapOracle::KnownByDescriptor(const Pose3& T_map_camera, const Camera& camera,
                                                   std::span<const Feature> own) const {
  const Eigen::Matrix3d R_camera_map = T_map_camera.RotationMatrix().transpose();
  const OracleRule& rule = impl_->rule;
  // A distorted projection folds points from far outside back into the image; no camera sees these.
  const double widest = camera.FieldOfView();
  ImageGrid grid(camera, rule.match_px);
  for (const SeenPoint& point : impl_->points) {
    const Eigen::Vector3d p_camera = R_camera_map * (point.p_map - T_map_camera.translation());
    if (p_camera.z() <= 0 || std::atan2(p_camera.head<2>().norm(), p_camera.z()) > widest) continue;
    const Eigen::Vector2d pixel = camera.Project(p_camera);
    if (camera.Contains(pixel, -rule.match_px)) grid.Add(pixel, point.descriptor);
  }
  std::vector<bool> known;
  known.reserve(own.size());
  for (const Feature& feature : own) {
    const Eigen::Vector2d pixel(feature.keypoint.u_px, feature.keypoint.v_px);
    known.push_back(grid.HasMatch(pixel, feature.descriptor, rule.max_hamming));
  }
  return known;
}

}  // namespace mapp
