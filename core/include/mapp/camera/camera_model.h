#pragma once

#include "mapp/base/status.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

/// Pinhole without distortion. Pixels: (0, 0) is the centre of the top-left pixel.
struct PinholeCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels

  Eigen::Vector2d Project(const Eigen::Vector3d& p_camera) const {
    return {fx * p_camera.x() / p_camera.z() + cx, fy * p_camera.y() / p_camera.z() + cy};
  }
  /// Point on the plane z = 1 that projects to `pixel`.
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy, 1.0};
  }
};

/// Pinhole with radial-tangential distortion k1, k2, p1, p2 (Brown 1966; OpenCV's and EuRoC's convention).
struct RadialTangentialCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0;

  Eigen::Vector2d Project(const Eigen::Vector3d& p_camera) const;
  /// Newton iterations on the distortion; converges for any pixel of a real lens.
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel) const;
};

/// A camera model that joins adds an alternative here, its coefficients to `Coefficients`, and its name to the codec.
using Projection = std::variant<PinholeCamera, RadialTangentialCamera>;

enum class SensorKind : uint8_t { kMono = 1, kMonoInertial = 2, kStereo = 3, kRgbd = 4 };
const char* SensorKindName(SensorKind kind);

/// One calibrated camera: model, image size and, for stereo, the baseline of the rectified pair.
struct Camera {
  Projection projection;
  int width_px = 0;
  int height_px = 0;
  /// Distance between the rectified stereo cameras, metres; 0 without a second camera.
  double stereo_baseline_m = 0;

  Eigen::Vector2d Project(const Eigen::Vector3d& p_camera) const;
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel) const;
  /// Whether the pixel lies in the image, `margin_px` away from its border.
  bool Contains(const Eigen::Vector2d& pixel, double margin_px = 0) const;
  Eigen::Vector2d FocalLengths() const;    ///< fx, fy in pixels
  double MeanFocalPx() const;              ///< geometric mean of both
  Eigen::Vector2d PrincipalPoint() const;  ///< cx, cy in pixels
  /// The same camera without distortion: the model of keypoints that were undistorted to it.
  PinholeCamera Undistorted() const;
  /// FOV = max(2 atan(cx/fx), 2 atan(cy/fy)), radians (paper section 4.1, equation 2).
  double FieldOfView() const;
  /// INVALID_ARGUMENT naming the first bad field: image size in [16, 16384], finite positive focal lengths, principal
  /// point inside the image, |coefficients| < 10, baseline in [0, 100) m.
  Status Validate() const;
};

/// "pinhole" or "radial-tangential", and their coefficients in the order of the struct's fields.
std::string ModelName(const Projection& projection);
std::vector<double> Coefficients(const Projection& projection);
/// INVALID_ARGUMENT for an unknown name or a wrong number of coefficients.
StatusOr<Projection> MakeProjection(const std::string& model, const std::vector<double>& coefficients);

}  // namespace mapp
