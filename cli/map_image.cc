#include "cli/map_image.h"

#include "cli/canvas.h"
#include "cli/legend.h"
#include "cli/session_track.h"
#include "cli/top_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace mapp {
namespace {

TopView MakeView(const MapImageContent& content, const std::vector<SessionTrack>& tracks,
                 const MapImageOptions& options) {
  std::vector<Pose3> cameras;
  std::vector<Eigen::Vector3d> points;
  for (const SessionTrack& track : tracks) {
    for (const TrackFrame& frame : track.frames) cameras.push_back(frame.T_map_camera);
  }
  points.reserve(content.map.points.size());
  for (const MapPointSummary& point : content.map.points) points.push_back(point.p_map);
  return TopView(cameras, points,
                 {kLegendMarginPx, kLegendMarginPx, options.width_px - kLegendWidthPx - 2 * kLegendMarginPx,
                  options.height_px - 2 * kLegendMarginPx});
}

/// Calls `draw(from, to, from_px, to_px)` for each stretch between frames that follow each other.
template <typename Draw>
void ForEachStretch(const SessionTrack& track, const TopView& view, const Draw& draw) {
  for (size_t i = 1; i < track.frames.size(); ++i) {
    if (!track.IsContinuous(i)) continue;
    const TrackFrame& from = track.frames[i - 1];
    const TrackFrame& to = track.frames[i];
    draw(from, to, view.ToPixel(from.T_map_camera.translation()), view.ToPixel(to.T_map_camera.translation()));
  }
}

void DrawPath(const SessionTrack& track, Color color, const TopView& view, Canvas& canvas) {
  using Pixel = Eigen::Vector2d;
  ForEachStretch(track, view, [&](const TrackFrame& from, const TrackFrame& to, const Pixel& a, const Pixel& b) {
    if (from.on_shared_map && to.on_shared_map) canvas.Line(a, b, 9, Tint(color));
  });
  ForEachStretch(track, view, [&](const TrackFrame&, const TrackFrame&, const Pixel& a, const Pixel& b) {
    canvas.Line(a, b, 2, color);
  });
}

void DrawMarker(FrameMark mark, const Eigen::Vector2d& pixel, Color color, Canvas& canvas) {
  constexpr int kRadiusPx = 5;
  switch (mark) {
    case FrameMark::kWhole:
      canvas.Disc(pixel, kRadiusPx, color, color);
      return;
    case FrameMark::kPartial:
      canvas.Disc(pixel, kRadiusPx, kWhite, color);
      return;
    case FrameMark::kShared:
      canvas.Diamond(pixel, kRadiusPx + 2, color);
      return;
    case FrameMark::kNone:
      return;
  }
}

void DrawTrack(const SessionTrack& track, Color color, const TopView& view, Canvas& canvas) {
  if (track.frames.empty()) return;
  for (const TrackFrame& frame : track.frames) {
    DrawMarker(frame.mark, view.ToPixel(frame.T_map_camera.translation()), color, canvas);
  }
  const Eigen::Vector2d start = view.ToPixel(track.frames.front().T_map_camera.translation());
  canvas.Circle(start, 11, 2, color);
  canvas.Text(start + Eigen::Vector2d(14, -8), fmt::format("{}", track.session_id), 0.55, color);
}

void DrawLegend(const MapImageContent& content, const std::vector<SessionTrack>& tracks, int left_px, Canvas& canvas) {
  const MapSummary& map = content.map.map;
  Legend legend(canvas, left_px, 48);
  legend.Title(map.name);
  legend.Note(fmt::format("revision {}, seen from above", map.revision));
  legend.Note(fmt::format("{} points (darker: higher)", content.map.points.size()));
  legend.Note(fmt::format("{} map frames", content.map.frames.size()));
  legend.Gap();
  for (size_t i = 0; i < tracks.size(); ++i) {
    legend.Entry(tracks[i].label, [&](const Eigen::Vector2d& pixel) {
      canvas.Line(pixel - Eigen::Vector2d(10, 0), pixel + Eigen::Vector2d(10, 0), 3, TrackColor(i));
    });
    legend.Note(fmt::format("      {} whole, {} partial, {} shared", tracks[i].CountMarks(FrameMark::kWhole),
                            tracks[i].CountMarks(FrameMark::kPartial), tracks[i].CountMarks(FrameMark::kShared)));
  }
  legend.Gap();
  const auto mark_entry = [&](const std::string& text, FrameMark mark) {
    legend.Entry(text, [&](const Eigen::Vector2d& pixel) { DrawMarker(mark, pixel, kPale, canvas); });
  };
  mark_entry("keyframe, whole (all fresh)", FrameMark::kWhole);
  mark_entry("keyframe, partial (fresh part)", FrameMark::kPartial);
  mark_entry("shared: nothing uploaded", FrameMark::kShared);
  legend.Entry("on a shared map", [&](const Eigen::Vector2d& pixel) {
    canvas.Line(pixel - Eigen::Vector2d(10, 0), pixel + Eigen::Vector2d(10, 0), 9, Tint(kPale));
    canvas.Line(pixel - Eigen::Vector2d(10, 0), pixel + Eigen::Vector2d(10, 0), 2, kPale);
  });
  legend.Entry("start of a session", [&](const Eigen::Vector2d& pixel) { canvas.Circle(pixel, 9, 2, kPale); });
}

}  // namespace

Status Validate(const MapImageOptions& options, int least_width_px, int least_height_px) {
  const auto check = [](const char* name, int size_px, int least_px) -> Status {
    if (size_px >= least_px && size_px <= kLargestImagePx) return absl::OkStatus();
    return absl::InvalidArgumentError(
        fmt::format("{}: must be in [{}, {}], got {}", name, least_px, kLargestImagePx, size_px));
  };
  MAPP_RETURN_IF_ERROR(check("width_px", options.width_px, least_width_px));
  return check("height_px", options.height_px, least_height_px);
}

void DrawPoints(const std::vector<MapPointSummary>& points, const TopView& view, const TopView::Viewport& area,
                int size_px, Canvas& canvas) {
  if (points.empty()) return;
  std::vector<double> heights;
  for (const MapPointSummary& point : points) heights.push_back(view.Height(point.p_map));
  std::vector<size_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return heights[a] < heights[b]; });
  for (size_t rank = 0; rank < order.size(); ++rank) {
    // By rank, not by height: a few stray points must not take the whole range of shades.
    const auto shade = static_cast<uint8_t>(215 - 120 * rank / order.size());
    const Eigen::Vector2d pixel = view.ToPixel(points[order[rank]].p_map);
    if (area.Contains(pixel)) canvas.FillSquare(pixel, size_px, {shade, shade, shade});
  }
}

StatusOr<std::string> DrawMap(const MapImageContent& content, const MapImageOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(options, kLeastMapWidthPx, kLeastMapHeightPx));
  const std::vector<SessionTrack> tracks = MakeTracks(content.map.frames, content.logs, content.sessions);
  const TopView view = MakeView(content, tracks, options);
  Canvas canvas(options.width_px, options.height_px);
  DrawPoints(content.map.points, view, {0, 0, options.width_px, options.height_px}, 2, canvas);
  for (size_t i = 0; i < tracks.size(); ++i) DrawPath(tracks[i], TrackColor(i), view, canvas);
  for (size_t i = 0; i < tracks.size(); ++i) DrawTrack(tracks[i], TrackColor(i), view, canvas);

  const int panel_left_px = options.width_px - kLegendWidthPx;
  canvas.FillRectangle(panel_left_px, 0, kLegendWidthPx, options.height_px, kPanel);
  DrawLegend(content, tracks, panel_left_px + kLegendMarginPx, canvas);
  DrawScaleBar(view.pixels_per_m(), panel_left_px + kLegendMarginPx, options.height_px - 2 * kLegendMarginPx, canvas);
  return canvas.EncodePng();
}

}  // namespace mapp
