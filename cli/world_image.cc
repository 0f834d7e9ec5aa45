#include "cli/world_image.h"

#include "cli/canvas.h"
#include "cli/change_colors.h"
#include "cli/legend.h"
#include "sim/world/world.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>

namespace mapp {
namespace {

constexpr int kWidthPx = 1600;
constexpr int kHeightPx = 1000;
constexpr Color kWall{90, 90, 90};
constexpr Color kObject{150, 160, 175};

/// World to picture; the longer side of the world lies along the picture's.
class Plan {
 public:
  explicit Plan(const Aabb& bounds_world) {
    const Eigen::Vector3d size_m = bounds_world.sizes();
    turned_ = size_m.y() > size_m.x();
    const double across_m = turned_ ? size_m.y() : size_m.x();
    const double along_m = turned_ ? size_m.x() : size_m.y();
    const double width_px = kWidthPx - kLegendWidthPx - 2 * kLegendMarginPx;
    const double height_px = kHeightPx - 2 * kLegendMarginPx;
    pixels_per_m_ = std::min(width_px / std::max(across_m, 1.0), height_px / std::max(along_m, 1.0));
    center_world_ = bounds_world.center();
    center_px_ = {kLegendMarginPx + width_px / 2, kHeightPx / 2.0};
  }

  Eigen::Vector2d ToPixel(const Eigen::Vector3d& p_world) const {
    const Eigen::Vector3d offset_m = pixels_per_m_ * (p_world - center_world_);
    // A quarter turn, not a mirror: y to the right, x down.
    return center_px_ +
           (turned_ ? Eigen::Vector2d(offset_m.y(), offset_m.x()) : Eigen::Vector2d(offset_m.x(), -offset_m.y()));
  }
  double pixels_per_m() const { return pixels_per_m_; }
  bool turned() const { return turned_; }

 private:
  bool turned_ = false;
  double pixels_per_m_ = 1;
  Eigen::Vector3d center_world_;
  Eigen::Vector2d center_px_;
};

/// Upright surfaces as lines, light where they begin above people's heads.
void DrawSurroundings(const sim::World& world, const Plan& plan, Canvas& canvas) {
  constexpr double kOverhead_m = 2.5;
  for (const sim::Quad& quad : world.surroundings.quads) {
    const Eigen::Vector3d normal = quad.NormalWorld();
    if (std::abs(normal.z()) > 0.5) continue;
    const std::array<Eigen::Vector3d, 4> corners = {quad.corner_world, quad.corner_world + quad.edge_u_world,
                                                    quad.corner_world + quad.edge_v_world,
                                                    quad.corner_world + quad.edge_u_world + quad.edge_v_world};
    const auto lowest = std::ranges::min_element(corners, {}, [](const Eigen::Vector3d& p) { return p.z(); });
    const Eigen::Vector3d along_world = Eigen::Vector3d::UnitZ().cross(normal);
    const auto [first, last] =
        std::ranges::minmax_element(corners, {}, [&](const Eigen::Vector3d& p) { return along_world.dot(p); });
    const bool overhead = lowest->z() > world.bounds_world.min().z() + kOverhead_m;
    canvas.Line(plan.ToPixel(*first), plan.ToPixel(*last), 1, overhead ? Tint(kWall) : kWall);
  }
}

void DrawBox(const sim::WorldObject& object, const Pose3& T_world_object, const Plan& plan, Color color,
             Canvas& canvas) {
  const Eigen::Vector3d half_m = object.size_m / 2;
  const std::array<Eigen::Vector3d, 4> corners = {
      Eigen::Vector3d(-half_m.x(), -half_m.y(), 0), Eigen::Vector3d(half_m.x(), -half_m.y(), 0),
      Eigen::Vector3d(half_m.x(), half_m.y(), 0), Eigen::Vector3d(-half_m.x(), half_m.y(), 0)};
  for (size_t i = 0; i < corners.size(); ++i) {
    canvas.Line(plan.ToPixel(T_world_object * corners[i]), plan.ToPixel(T_world_object * corners[(i + 1) % 4]), 2,
                color);
  }
}

/// Objects as they stand at first, and in colour what becomes of them.
void DrawObjects(const sim::World& world, const Plan& plan, Canvas& canvas) {
  std::map<uint32_t, const sim::WorldObject*> objects;
  for (const sim::WorldObject& object : world.objects) {
    objects[object.id] = &object;
    const std::optional<Pose3>& at_first = object.placements.front().T_world_object;
    if (at_first) DrawBox(object, *at_first, plan, kObject, canvas);
  }
  for (const sim::WorldChange& change : sim::ChangesOf(world)) {
    const sim::WorldObject& object = *objects.at(change.object_id);
    const std::optional<Pose3>& before = change.T_world_object_before;
    const std::optional<Pose3>& after = change.T_world_object_after;
    if (before && !after) DrawBox(object, *before, plan, kVanishedColor, canvas);
    if (after && !before) DrawBox(object, *after, plan, kAppearedColor, canvas);
    if (before && after) {
      DrawBox(object, *after, plan, kMovedFromColor, canvas);
      canvas.Line(plan.ToPixel(before->translation()), plan.ToPixel(after->translation()), 1, kMovedFromColor);
    }
  }
}

void DrawVisit(const sim::Visit& visit, const Plan& plan, Canvas& canvas) {
  const Color color = TrackColor(static_cast<size_t>(visit.user));
  for (size_t i = 1; i < visit.poses.size(); ++i) {
    canvas.Line(plan.ToPixel(visit.poses[i - 1].T_world_camera.translation()),
                plan.ToPixel(visit.poses[i].T_world_camera.translation()), 2, color);
  }
  const Eigen::Vector2d start = plan.ToPixel(visit.poses.front().T_world_camera.translation());
  canvas.Disc(start, 6, kWhite, color);
  canvas.Text(start + Eigen::Vector2d(9, -7), fmt::format("{}", visit.user), 0.55, color);
}

void DrawLegend(const sim::Simulation& simulation, const Plan& plan, Canvas& canvas) {
  const int left_px = kWidthPx - kLegendWidthPx;
  canvas.FillRectangle(left_px, 0, kLegendWidthPx, kHeightPx, kPanel);
  Legend legend(canvas, left_px + kLegendMarginPx, 48);
  legend.Title(fmt::format("{}, seed {}", simulation.world->setting, simulation.world->seed));
  legend.Note(plan.turned() ? "from above; y to the right, x down" : "from above; x to the right, y up");
  legend.Note(
      fmt::format("{} objects, {} people passing", simulation.world->objects.size(), simulation.world->passers.size()));
  legend.Gap();
  const auto square = [&](Color color) {
    return [&canvas, color](const Eigen::Vector2d& pixel) { canvas.FillSquare(pixel, 12, color); };
  };
  legend.Entry("object that may change", square(kObject));
  legend.Entry("vanishes", square(kVanishedColor));
  legend.Entry("appears", square(kAppearedColor));
  legend.Entry("is moved here", square(kMovedFromColor));
  legend.Gap();
  for (const sim::Visit& visit : simulation.visits) {
    constexpr int kLowestPx = kHeightPx - 130;
    if (legend.y_px() > kLowestPx) {
      legend.Note(fmt::format("and {} more users", simulation.visits.size() - static_cast<size_t>(visit.user)));
      break;
    }
    const Color color = TrackColor(static_cast<size_t>(visit.user));
    legend.Entry(fmt::format("user {}: {:.0f} m, {}", visit.user, visit.path_m, visit.rig.name),
                 [&](const Eigen::Vector2d& pixel) {
                   canvas.Line(pixel - Eigen::Vector2d(10, 0), pixel + Eigen::Vector2d(10, 0), 3, color);
                 });
  }
  DrawScaleBar(plan.pixels_per_m(), left_px + kLegendMarginPx, kHeightPx - 2 * kLegendMarginPx, canvas);
}

}  // namespace

StatusOr<std::string> DrawWorld(const sim::Simulation& simulation) {
  const Plan plan(simulation.world->bounds_world);
  Canvas canvas(kWidthPx, kHeightPx);
  DrawSurroundings(*simulation.world, plan, canvas);
  DrawObjects(*simulation.world, plan, canvas);
  for (const sim::Visit& visit : simulation.visits) DrawVisit(visit, plan, canvas);
  DrawLegend(simulation, plan, canvas);
  return canvas.EncodePng();
}

}  // namespace mapp
