#include "mapp/camera/camera_model.h"

#include <Eigen/LU>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// Distorted position of a point of the plane z = 1, and its Jacobian.
struct Distorted {
  Eigen::Vector2d position;
  Eigen::Matrix2d jacobian;
};

Distorted Distort(const RadialTangentialCamera& camera, const Eigen::Vector2d& normalized) {
  const double x = normalized.x();
  const double y = normalized.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (camera.k1 + r2 * camera.k2);
  const double radial_slope = camera.k1 + 2 * camera.k2 * r2;  // d radial / d r2
  Distorted out;
  out.position = {x * radial + 2 * camera.p1 * x * y + camera.p2 * (r2 + 2 * x * x),
                  y * radial + camera.p1 * (r2 + 2 * y * y) + 2 * camera.p2 * x * y};
  const double cross = 2 * x * y * radial_slope + 2 * camera.p1 * x + 2 * camera.p2 * y;
  out.jacobian << radial + 2 * x * x * radial_slope + 2 * camera.p1 * y + 6 * camera.p2 * x, cross, cross,
      radial + 2 * y * y * radial_slope + 6 * camera.p1 * y + 2 * camera.p2 * x;
  return out;
}

Status CheckFinite(const std::string& field, double value) {
  if (std::isfinite(value)) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: must be finite, got {}", field, value));
}

}  // namespace

Eigen::Vector2d RadialTangentialCamera::Project(const Eigen::Vector3d& p_camera) const {
  const Eigen::Vector2d distorted = Distort(*this, p_camera.hnormalized()).position;
  return {fx * distorted.x() + cx, fy * distorted.y() + cy};
}

Eigen::Vector3d RadialTangentialCamera::Unproject(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d target((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d normalized = target;
  constexpr int kMaxIterations = 20;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Distorted now = Distort(*this, normalized);
    const Eigen::Vector2d step = now.jacobian.inverse() * (target - now.position);
    // Far outside a real lens's field the polynomial folds back and has no solution: keep the last good estimate.
    if (!step.allFinite()) break;
    normalized += step;
    if (step.squaredNorm() < 1e-24) break;
  }
  return normalized.homogeneous();
}

const char* SensorKindName(SensorKind kind) {
  switch (kind) {
    case SensorKind::kMono:
      return "mono";
    case SensorKind::kMonoInertial:
      return "mono+imu";
    case SensorKind::kStereo:
      return "stereo";
    case SensorKind::kRgbd:
      return "rgbd";
  }
  return "unknown";
}

Eigen::Vector2d Camera::Project(const Eigen::Vector3d& p_camera) const {
  return std::visit([&](const auto& model) { return model.Project(p_camera); }, projection);
}

Eigen::Vector3d Camera::Unproject(const Eigen::Vector2d& pixel) const {
  return std::visit([&](const auto& model) { return model.Unproject(pixel); }, projection);
}

bool Camera::Contains(const Eigen::Vector2d& pixel, double margin_px) const {
  return pixel.x() >= margin_px - 0.5 && pixel.y() >= margin_px - 0.5 && pixel.x() < width_px - 0.5 - margin_px &&
         pixel.y() < height_px - 0.5 - margin_px;
}

Eigen::Vector2d Camera::FocalLengths() const {
  return std::visit([](const auto& model) { return Eigen::Vector2d(model.fx, model.fy); }, projection);
}

double Camera::MeanFocalPx() const { return std::sqrt(FocalLengths().prod()); }

Eigen::Vector2d Camera::PrincipalPoint() const {
  return std::visit([](const auto& model) { return Eigen::Vector2d(model.cx, model.cy); }, projection);
}

PinholeCamera Camera::Undistorted() const {
  const Eigen::Vector2d f = FocalLengths();
  const Eigen::Vector2d c = PrincipalPoint();
  return {.fx = f.x(), .fy = f.y(), .cx = c.x(), .cy = c.y()};
}

double Camera::FieldOfView() const {
  const Eigen::Vector2d f = FocalLengths();
  const Eigen::Vector2d c = PrincipalPoint();
  return std::max(2 * std::atan(c.x() / f.x()), 2 * std::atan(c.y() / f.y()));
}

Status Camera::Validate() const {
  for (const auto& [field, value] : {std::pair{"camera.width_px", width_px}, {"camera.height_px", height_px}}) {
    if (value < 16 || value > 16384) {
      return absl::InvalidArgumentError(fmt::format("{}: must be in [16, 16384], got {}", field, value));
    }
  }
  const std::vector<double> coefficients = Coefficients(projection);
  static constexpr std::array<const char*, 8> kNames = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"};
  for (size_t i = 0; i < coefficients.size(); ++i) {
    const std::string field = fmt::format("camera.{}", kNames[i]);
    MAPP_RETURN_IF_ERROR(CheckFinite(field, coefficients[i]));
    if (i < 2 && !(coefficients[i] > 0)) {
      return absl::InvalidArgumentError(fmt::format("{}: must be positive, got {}", field, coefficients[i]));
    }
    if (i >= 4 && std::abs(coefficients[i]) >= 10) {
      return absl::InvalidArgumentError(fmt::format("{}: must be in (-10, 10), got {}", field, coefficients[i]));
    }
  }
  const Eigen::Vector2d center = PrincipalPoint();
  if (!(center.x() > 0 && center.x() < width_px)) {
    return absl::InvalidArgumentError(
        fmt::format("camera.cx: must lie in the image (0, {}), got {}", width_px, center.x()));
  }
  if (!(center.y() > 0 && center.y() < height_px)) {
    return absl::InvalidArgumentError(
        fmt::format("camera.cy: must lie in the image (0, {}), got {}", height_px, center.y()));
  }
  if (!(stereo_baseline_m >= 0 && stereo_baseline_m < 100)) {
    return absl::InvalidArgumentError(
        fmt::format("camera.stereo_baseline_m: must be in [0, 100), got {}", stereo_baseline_m));
  }
  return absl::OkStatus();
}

std::string ModelName(const Projection& projection) {
  return std::holds_alternative<PinholeCamera>(projection) ? "pinhole" : "radial-tangential";
}

std::vector<double> Coefficients(const Projection& projection) {
  if (const auto* pinhole = std::get_if<PinholeCamera>(&projection)) {
    return {pinhole->fx, pinhole->fy, pinhole->cx, pinhole->cy};
  }
  const auto& model = std::get<RadialTangentialCamera>(projection);
  return {model.fx, model.fy, model.cx, model.cy, model.k1, model.k2, model.p1, model.p2};
}

StatusOr<Projection> MakeProjection(const std::string& model, const std::vector<double>& c) {
  const auto check_size = [&](size_t expected) -> Status {
    if (c.size() == expected) return absl::OkStatus();
    return absl::InvalidArgumentError(
        fmt::format("camera.coefficients: model {} takes {}, got {}", model, expected, c.size()));
  };
  if (model == "pinhole") {
    MAPP_RETURN_IF_ERROR(check_size(4));
    return PinholeCamera{.fx = c[0], .fy = c[1], .cx = c[2], .cy = c[3]};
  }
  if (model == "radial-tangential") {
    MAPP_RETURN_IF_ERROR(check_size(8));
    return RadialTangentialCamera{
        .fx = c[0], .fy = c[1], .cx = c[2], .cy = c[3], .k1 = c[4], .k2 = c[5], .p1 = c[6], .p2 = c[7]};
  }
  return absl::InvalidArgumentError(
      fmt::format("camera.model: must be pinhole or radial-tangential, got \"{}\"", model));
}

}  // namespace mapp
