#include "cli/change_image.h"

#include "cli/box_outline.h"
#include "cli/change_text.h"
#include "cli/label_places.h"
#include "cli/legend.h"
#include "cli/top_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

namespace mapp {
namespace {

using Viewport = TopView::Viewport;

constexpr int kCaptionPx = 34;
constexpr double kLabelScale = 0.55;

/// A box of a change as it is drawn at a moment.
struct DrawnBox {
  uint64_t change_id = 0;
  const OrientedBox* box_map = nullptr;
  Color color;
  bool is_there = true;  ///< at that moment
};

std::vector<DrawnBox> BoxesAt(const std::vector<ChangeSummary>& changes, MapMoment moment) {
  std::vector<DrawnBox> boxes;
  for (const ChangeSummary& change : changes) {
    const bool moved = change.kind == ChangeKind::kMoved;
    if (change.box_map_before) {
      boxes.push_back(
          {change.id, &*change.box_map_before, moved ? kMovedFromColor : kVanishedColor, moment != MapMoment::kAfter});
    }
    if (change.box_map_after) {
      boxes.push_back(
          {change.id, &*change.box_map_after, moved ? kMovedToColor : kAppearedColor, moment != MapMoment::kBefore});
    }
  }
  return boxes;
}

std::vector<Eigen::Vector2d> OutlineOf(const OrientedBox& box_map, const TopView& view) {
  std::vector<Eigen::Vector2d> corners_px;
  for (const Eigen::Vector3d& corner_map : CornersOf(box_map)) corners_px.push_back(view.ToPixel(corner_map));
  return ConvexHull(std::move(corners_px));
}

/// All corners of all boxes.
std::vector<Eigen::Vector3d> BoxCorners(const std::vector<ChangeSummary>& changes) {
  std::vector<Eigen::Vector3d> corners_map;
  for (const DrawnBox& box : BoxesAt(changes, MapMoment::kBoth)) {
    for (const Eigen::Vector3d& corner_map : CornersOf(*box.box_map)) corners_map.push_back(corner_map);
  }
  return corners_map;
}

/// The whole map, and every box even where points are only strays.
TopView ViewOfAll(const ChangedMap& map, const Viewport& viewport) {
  std::vector<Pose3> cameras;
  std::vector<Eigen::Vector3d> always_map = BoxCorners(map.changes);
  for (const MapFrameSummary& frame : map.now.frames) {
    cameras.push_back(frame.T_map_camera);
    always_map.push_back(frame.T_map_camera.translation());
  }
  std::vector<Eigen::Vector3d> points_map;
  for (const MapPointSummary& point : map.now.points) points_map.push_back(point.p_map);
  return TopView(cameras, points_map, viewport).FittedTo(always_map, points_map, viewport);
}

/// The changes with what is around them; the whole map without changes.
TopView ViewAroundChanges(const ChangedMap& map, const Viewport& viewport) {
  const TopView all = ViewOfAll(map, viewport);
  if (map.changes.empty()) return all;
  Aabb around_map;
  for (const Eigen::Vector3d& corner_map : BoxCorners(map.changes)) around_map.extend(corner_map);
  // So much that one sees where in the room it is.
  const double margin_m = std::clamp(around_map.sizes().maxCoeff() / 2, 1.0, 2.0);
  const OrientedBox surroundings{.T_frame_box = {Eigen::Quaterniond::Identity(), around_map.center()},
                                 .size_m = around_map.sizes() + Eigen::Vector3d::Constant(2 * margin_m)};
  const std::array<Eigen::Vector3d, 8> corners_map = CornersOf(surroundings);
  return all.FittedTo({corners_map.begin(), corners_map.end()}, {}, viewport);
}

/// Grey ones below, those of the changes above.
void DrawChangedPoints(const ChangedMap& map, MapMoment moment, int size_px, const TopView& view, const Viewport& area,
                       Canvas& canvas) {
  const PointRoles roles(map.changes);
  std::vector<MapPointSummary> unchanged;
  std::vector<MapPointSummary> changed;
  for (const MapPointSummary& point : PointsAt(map, moment)) {
    (roles.Of(point.id) == PointRole::kUnchanged ? unchanged : changed).push_back(point);
  }
  DrawPoints(unchanged, view, area, size_px, canvas);
  for (const MapPointSummary& point : changed) {
    const Eigen::Vector2d pixel = view.ToPixel(point.p_map);
    if (area.Contains(pixel)) canvas.FillSquare(pixel, size_px + 2, ColorOf(roles.Of(point.id)));
  }
}

void DrawArrows(const std::vector<ChangeSummary>& changes, const TopView& view, Canvas& canvas) {
  for (const ChangeSummary& change : changes) {
    if (change.kind != ChangeKind::kMoved) continue;
    canvas.Arrow(view.ToPixel(change.box_map_before->T_frame_box.translation()),
                 view.ToPixel(change.box_map_after->T_frame_box.translation()), 2, kMovedToColor);
  }
}

void DrawBoxes(const std::vector<DrawnBox>& boxes, const TopView& view, const Viewport& area, Canvas& canvas) {
  LabelPlaces places(area);
  std::vector<std::vector<Eigen::Vector2d>> outlines;
  for (const DrawnBox& box : boxes) {
    outlines.push_back(OutlineOf(*box.box_map, view));
    places.KeepClear(outlines.back());
  }
  for (size_t i = 0; i < boxes.size(); ++i) {
    canvas.Polygon(outlines[i], 2, boxes[i].is_there ? boxes[i].color : Tint(boxes[i].color));
  }
  for (size_t i = 0; i < boxes.size(); ++i) {
    const std::string text = fmt::format("#{}", boxes[i].change_id);
    const Eigen::Vector2d size_px = Canvas::TextSize(text, kLabelScale);
    const Eigen::Vector2d left_baseline = places.Take(outlines[i], size_px);
    constexpr int kHaloPx = 2;  // letters are not read on points
    canvas.FillRectangle(
        static_cast<int>(left_baseline.x()) - kHaloPx, static_cast<int>(left_baseline.y() - size_px.y()) - kHaloPx,
        static_cast<int>(size_px.x()) + 2 * kHaloPx, static_cast<int>(size_px.y()) + 2 * kHaloPx, kWhite);
    canvas.Text(left_baseline, text, kLabelScale, boxes[i].is_there ? boxes[i].color : Tint(boxes[i].color));
  }
}

Color LegendColor(const ChangeSummary& change) {
  if (change.kind == ChangeKind::kVanished) return kVanishedColor;
  return change.kind == ChangeKind::kAppeared ? kAppearedColor : kMovedToColor;
}

void DrawChangeLegend(const ChangedMap& map, bool before_after, double pixels_per_m, const MapImageOptions& options,
                      Canvas& canvas) {
  const int panel_left_px = options.width_px - kLegendWidthPx;
  const int left_px = panel_left_px + kLegendMarginPx;
  canvas.FillRectangle(panel_left_px, 0, kLegendWidthPx, options.height_px, kPanel);
  Legend legend(canvas, left_px, 48);
  const auto square = [&canvas](Color color) {
    return [&canvas, color](const Eigen::Vector2d& pixel) { canvas.FillSquare(pixel, 12, color); };
  };
  legend.Title(map.now.map.name);
  legend.Note(fmt::format("revision {}, seen from above", map.now.map.revision));
  legend.Note(fmt::format("{} points", map.now.points.size()));
  legend.Gap();
  legend.Entry("vanished", square(kVanishedColor));
  legend.Entry("appeared", square(kAppearedColor));
  legend.Entry("moved from here", square(kMovedFromColor));
  legend.Entry("moved to here", square(kMovedToColor));
  if (before_after) {
    legend.Entry("not there then", [&canvas](const Eigen::Vector2d& pixel) {
      const Eigen::Vector2d x(6, 0), y(0, 6);
      canvas.Polygon({pixel - x - y, pixel + x - y, pixel + x + y, pixel - x + y}, 1, Tint(kPale));
    });
  }
  legend.Gap();
  if (map.changes.empty()) legend.Note("no changes");
  if (map.num_lost > 0) {
    legend.Note(fmt::format("{} points not shown: retired,", map.num_lost));
    legend.Note("and the past is compacted away");
    legend.Gap();
  }
  const int lowest_px = options.height_px - 120;  // the scale bar is below
  for (size_t i = 0; i < map.changes.size(); ++i) {
    const ChangeSummary& change = map.changes[i];
    if (legend.y_px() > lowest_px) {
      legend.Note(fmt::format("and {} more", map.changes.size() - i));
      break;
    }
    legend.Entry(fmt::format("#{} {} {:.2f} {}", change.id, NameOf(kWorldChangeKinds, change.kind), change.confidence,
                             NameOf(kWorldChangeStatuses, change.status)),
                 square(LegendColor(change)));
  }
  DrawScaleBar(pixels_per_m, left_px, options.height_px - 2 * kLegendMarginPx, canvas);
}

void DrawFrame(const Viewport& area, Canvas& canvas) {
  const Eigen::Vector2d top_left(area.left_px - 1, area.top_px - 1);
  const Eigen::Vector2d bottom_right(area.left_px + area.width_px, area.top_px + area.height_px);
  canvas.Polygon({top_left, {bottom_right.x(), top_left.y()}, bottom_right, {top_left.x(), bottom_right.y()}}, 1,
                 Tint(kPale));
}

}  // namespace

StatusOr<std::string> DrawChanges(const ChangedMap& map, const MapImageOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(options, kLeastChangesWidthPx, kLeastChangesHeightPx));
  const Viewport area{kLegendMarginPx, kLegendMarginPx, options.width_px - kLegendWidthPx - 2 * kLegendMarginPx,
                      options.height_px - 2 * kLegendMarginPx};
  const TopView view = ViewOfAll(map, area);
  Canvas canvas(options.width_px, options.height_px);
  DrawChangedPoints(map, MapMoment::kBoth, /*size_px=*/2, view, area, canvas);
  DrawArrows(map.changes, view, canvas);
  DrawBoxes(BoxesAt(map.changes, MapMoment::kBoth), view, area, canvas);
  DrawChangeLegend(map, /*before_after=*/false, view.pixels_per_m(), options, canvas);
  return canvas.EncodePng();
}

StatusOr<std::string> DrawBeforeAndAfter(const ChangedMap& map, const MapImageOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(options, kLeastChangesWidthPx, kLeastChangesHeightPx));
  const int width_px = (options.width_px - kLegendWidthPx - 3 * kLegendMarginPx) / 2;
  const int height_px = options.height_px - 2 * kLegendMarginPx - kCaptionPx;
  const Viewport before{kLegendMarginPx, kLegendMarginPx + kCaptionPx, width_px, height_px};
  const Viewport after{2 * kLegendMarginPx + width_px, before.top_px, width_px, height_px};
  Canvas canvas(options.width_px, options.height_px);
  double pixels_per_m = 1;
  const auto draw = [&](const std::string& caption, MapMoment moment, const Viewport& area) {
    const TopView view = ViewAroundChanges(map, area);
    pixels_per_m = view.pixels_per_m();
    canvas.Text(Eigen::Vector2d(area.left_px, area.top_px - 12), caption, 0.62, kInk);
    DrawChangedPoints(map, moment, /*size_px=*/3, view, area, canvas);
    DrawBoxes(BoxesAt(map.changes, moment), view, area, canvas);
    DrawFrame(area, canvas);
  };
  draw("before", MapMoment::kBefore, before);
  draw("after", MapMoment::kAfter, after);
  DrawChangeLegend(map, /*before_after=*/true, pixels_per_m, options, canvas);
  return canvas.EncodePng();
}

}  // namespace mapp
