#include "cli/canvas.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace mapp {
namespace {

/// Positions go to OpenCV with this many fractional bits.
constexpr int kShift = 4;
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

cv::Scalar ToScalar(Color color) { return {double(color.blue), double(color.green), double(color.red)}; }

cv::Point ToFixedPoint(const Eigen::Vector2d& pixel) {
  // OpenCV's fixed-point drawing overflows on far-away positions; these are out of any picture.
  constexpr double kFarPx = 1e6;
  const Eigen::Vector2d clamped = pixel.cwiseMax(-kFarPx).cwiseMin(kFarPx) * (1 << kShift);
  return {static_cast<int>(std::lround(clamped.x())), static_cast<int>(std::lround(clamped.y()))};
}

/// The font knows no other characters.
std::string ToAscii(const std::string& text) {
  std::string ascii;
  for (const char c : text) {
    const auto byte = static_cast<uint8_t>(c);
    const bool continues_character = (byte & 0xC0) == 0x80;
    if (!continues_character) ascii += byte < 0x80 ? c : '?';
  }
  return ascii;
}

}  // namespace

Color Tint(Color color) {
  const auto mix = [](uint8_t channel) { return static_cast<uint8_t>(255 - (255 - channel) * 3 / 8); };
  return {mix(color.red), mix(color.green), mix(color.blue)};
}

struct Canvas::Impl {
  cv::Mat bgr;
};

Canvas::Canvas(int width_px, int height_px)
    : impl_(new Impl{cv::Mat(height_px, width_px, CV_8UC3, cv::Scalar(255, 255, 255))}) {}
Canvas::~Canvas() = default;

void Canvas::Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, int thickness_px, Color color) {
  cv::line(impl_->bgr, ToFixedPoint(from), ToFixedPoint(to), ToScalar(color), thickness_px, cv::LINE_AA, kShift);
}

void Canvas::Circle(const Eigen::Vector2d& center, int radius_px, int thickness_px, Color color) {
  cv::circle(impl_->bgr, ToFixedPoint(center), radius_px << kShift, ToScalar(color), thickness_px, cv::LINE_AA, kShift);
}

void Canvas::Disc(const Eigen::Vector2d& center, int radius_px, Color fill, Color edge) {
  cv::circle(impl_->bgr, ToFixedPoint(center), radius_px << kShift, ToScalar(fill), cv::FILLED, cv::LINE_AA, kShift);
  Circle(center, radius_px, 2, edge);
}

void Canvas::Diamond(const Eigen::Vector2d& center, int radius_px, Color fill) {
  const double r = radius_px;
  std::vector<cv::Point> corners;
  for (const Eigen::Vector2d& corner :
       {Eigen::Vector2d(0, -r), Eigen::Vector2d(r, 0), Eigen::Vector2d(0, r), Eigen::Vector2d(-r, 0)}) {
    corners.push_back(ToFixedPoint(center + corner));
  }
  cv::fillConvexPoly(impl_->bgr, corners, ToScalar(fill), cv::LINE_AA, kShift);
  cv::polylines(impl_->bgr, corners, /*isClosed=*/true, ToScalar(kWhite), 1, cv::LINE_AA, kShift);
}

void Canvas::Polygon(const std::vector<Eigen::Vector2d>& corners, int thickness_px, Color color) {
  std::vector<cv::Point> points;
  for (const Eigen::Vector2d& corner : corners) points.push_back(ToFixedPoint(corner));
  cv::polylines(impl_->bgr, points, /*isClosed=*/true, ToScalar(color), thickness_px, cv::LINE_AA, kShift);
}

void Canvas::Arrow(const Eigen::Vector2d& from, const Eigen::Vector2d& to, int thickness_px, Color color) {
  const Eigen::Vector2d along = to - from;
  if (along.norm() < 1) return;
  const double head_px = std::min(12.0, along.norm() / 2);
  const Eigen::Vector2d back = -along.normalized() * head_px;
  const Eigen::Vector2d aside = 0.5 * Eigen::Vector2d(-back.y(), back.x());
  Line(from, to, thickness_px, color);
  Line(to, to + back + aside, thickness_px, color);
  Line(to, to + back - aside, thickness_px, color);
}

void Canvas::FillSquare(const Eigen::Vector2d& center, int size_px, Color color) {
  const Eigen::Vector2d corner = center - Eigen::Vector2d::Constant((size_px - 1) / 2.0);
  if (corner.minCoeff() < 0 || corner.x() > impl_->bgr.cols || corner.y() > impl_->bgr.rows) return;
  FillRectangle(static_cast<int>(corner.x()), static_cast<int>(corner.y()), size_px, size_px, color);
}

void Canvas::FillRectangle(int left_px, int top_px, int width_px, int height_px, Color color) {
  cv::rectangle(impl_->bgr, cv::Rect(left_px, top_px, width_px, height_px), ToScalar(color), cv::FILLED);
}

void Canvas::Text(const Eigen::Vector2d& left_baseline, const std::string& text, double scale, Color color) {
  const cv::Point origin(static_cast<int>(std::lround(left_baseline.x())),
                         static_cast<int>(std::lround(left_baseline.y())));
  cv::putText(impl_->bgr, ToAscii(text), origin, kFont, scale, ToScalar(color), 1, cv::LINE_AA);
}

Eigen::Vector2d Canvas::TextSize(const std::string& text, double scale) {
  const cv::Size size = cv::getTextSize(ToAscii(text), kFont, scale, /*thickness=*/1, /*baseLine=*/nullptr);
  return {size.width, size.height};
}

StatusOr<std::string> Canvas::EncodePng() const {
  try {
    std::vector<uint8_t> bytes;
    if (!cv::imencode(".png", impl_->bgr, bytes)) return absl::InternalError("encoding a PNG failed");
    return std::string(bytes.begin(), bytes.end());
  } catch (const cv::Exception& e) {
    return absl::InternalError(fmt::format("encoding a PNG: {}", e.what()));
  }
}

}  // namespace mapp
