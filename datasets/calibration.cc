#include "datasets/calibration.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>

namespace mapp {
namespace {

// The TUM RGB-D data set's unit, for folders that do not state theirs.
constexpr double kTumDepthUnitsPerMetre = 5000.0;
constexpr double kMaxRotationError = 1e-3;
constexpr int kMaxEdgePx = 1 << 20;  // only guards the cast; Camera::Validate() knows the real limit

Status BadKey(const std::string& key, const std::string& problem) {
  return absl::InvalidArgumentError(fmt::format("{}: {}", key, problem));
}

StatusOr<double> ReadNumber(const cv::FileNode& node, const std::string& key) {
  if (!node.isInt() && !node.isReal()) return BadKey(key, "a number expected");
  const double value = node.real();
  if (!std::isfinite(value)) return BadKey(key, "must be finite");
  return value;
}

StatusOr<std::vector<double>> ReadNumbers(const cv::FileNode& node, const std::string& key, size_t count) {
  if (!node.isSeq() || node.size() != count) return BadKey(key, fmt::format("a list of {} numbers expected", count));
  std::vector<double> values;
  for (size_t i = 0; i < count; ++i) {
    MAPP_ASSIGN_OR_RETURN(values.emplace_back(), ReadNumber(node[static_cast<int>(i)], fmt::format("{}[{}]", key, i)));
  }
  return values;
}

StatusOr<int> ReadEdge(double value, const std::string& key) {
  if (value < 1 || value > kMaxEdgePx || value != std::floor(value)) {
    return BadKey(key, fmt::format("a number of pixels expected, got {}", value));
  }
  return static_cast<int>(value);
}

Status CheckName(const cv::FileNode& node, const std::string& key, const std::string& expected) {
  const std::string name = node.isString() ? node.string() : "";
  if (node.empty() || name == expected) return absl::OkStatus();
  return BadKey(key, fmt::format("'{}' expected, got '{}'", expected, name));
}

StatusOr<Camera> ReadCamera(const cv::FileStorage& yaml) {
  MAPP_RETURN_IF_ERROR(CheckName(yaml["sensor_type"], "sensor_type", "camera"));
  MAPP_RETURN_IF_ERROR(CheckName(yaml["camera_model"], "camera_model", "pinhole"));
  MAPP_RETURN_IF_ERROR(CheckName(yaml["distortion_model"], "distortion_model", "radial-tangential"));
  MAPP_ASSIGN_OR_RETURN(const auto resolution, ReadNumbers(yaml["resolution"], "resolution", 2));
  MAPP_ASSIGN_OR_RETURN(const auto f, ReadNumbers(yaml["intrinsics"], "intrinsics", 4));
  std::vector<double> k(4, 0.0);
  if (!yaml["distortion_coefficients"].empty()) {
    MAPP_ASSIGN_OR_RETURN(k, ReadNumbers(yaml["distortion_coefficients"], "distortion_coefficients", 4));
  }
  for (size_t i = 0; i < 2; ++i) {
    if (f[i] <= 0)
      return BadKey(fmt::format("intrinsics[{}]", i), fmt::format("focal length must be positive, got {}", f[i]));
  }
  Camera camera;
  MAPP_ASSIGN_OR_RETURN(camera.width_px, ReadEdge(resolution[0], "resolution[0]"));
  MAPP_ASSIGN_OR_RETURN(camera.height_px, ReadEdge(resolution[1], "resolution[1]"));
  if (k == std::vector<double>(4, 0.0)) {
    camera.projection = PinholeCamera{f[0], f[1], f[2], f[3]};
  } else {
    camera.projection = RadialTangentialCamera{f[0], f[1], f[2], f[3], k[0], k[1], k[2], k[3]};
  }
  MAPP_RETURN_IF_ERROR(camera.Validate());
  return camera;
}

StatusOr<Pose3> ReadBodyPose(const cv::FileNode& node) {
  if (node.empty()) return Pose3();
  if (!node.isMap()) return BadKey("T_BS", "a map with cols, rows and data expected");
  MAPP_ASSIGN_OR_RETURN(const auto values, ReadNumbers(node["data"], "T_BS.data", 16));
  const Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data());
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  const double error = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (error > kMaxRotationError || R.row(0).cross(R.row(1)).dot(R.row(2)) < 0) {
    return BadKey("T_BS.data", "its upper left part is no rotation");
  }
  return Pose3::FromMatrix(matrix);
}

StatusOr<double> ReadDepthScale(const cv::FileNode& node) {
  if (node.empty()) return kTumDepthUnitsPerMetre;
  MAPP_ASSIGN_OR_RETURN(const double scale, ReadNumber(node, "depth_scale"));
  if (scale <= 0) return BadKey("depth_scale", fmt::format("must be positive, got {}", scale));
  return scale;
}

StatusOr<CameraCalibration> ReadKeys(const cv::FileStorage& yaml) {
  CameraCalibration calibration;
  MAPP_ASSIGN_OR_RETURN(calibration.camera, ReadCamera(yaml));
  MAPP_ASSIGN_OR_RETURN(calibration.T_body_camera, ReadBodyPose(yaml["T_BS"]));
  MAPP_ASSIGN_OR_RETURN(calibration.depth_units_per_metre, ReadDepthScale(yaml["depth_scale"]));
  return calibration;
}

}  // namespace

StatusOr<CameraCalibration> ReadCameraCalibration(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return absl::NotFoundError(fmt::format("{}: no such file", file));
  try {
    const cv::FileStorage yaml(file, cv::FileStorage::READ | cv::FileStorage::FORMAT_YAML);
    if (!yaml.isOpened()) return absl::DataLossError(fmt::format("{}: cannot be read", file));
    StatusOr<CameraCalibration> calibration = ReadKeys(yaml);
    if (!calibration.ok()) return Annotate(calibration.status(), file);
    return calibration;
  } catch (const cv::Exception& exception) {
    // OpenCV's YAML parser puts "file(line): problem" where the function's name belongs.
    if (exception.code == cv::Error::StsParseError) return absl::InvalidArgumentError(exception.func);
    return absl::InvalidArgumentError(
        fmt::format("{}: not a YAML file that begins with %YAML:1.0 ({})", file, exception.err));
  }
}

Status WriteCameraCalibration(const std::string& file, const CameraCalibration& calibration, double rate_hz) {
  const Camera& camera = calibration.camera;
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> T_body_camera = calibration.T_body_camera.Matrix();
  std::vector<double> coefficients = Coefficients(camera.projection);
  coefficients.resize(8, 0.0);
  const std::vector<double> intrinsics(coefficients.begin(), coefficients.begin() + 4);
  const std::vector<double> distortion(coefficients.begin() + 4, coefficients.end());
  std::ofstream stream(file);
  stream << "%YAML:1.0\n# keys as in an EuRoC sensor.yaml\nsensor_type: camera\n"
         << fmt::format("rate_hz: {}\nresolution: [{}, {}]\n", rate_hz, camera.width_px, camera.height_px)
         << fmt::format("camera_model: pinhole\nintrinsics: [{}] # fu, fv, cu, cv [px]\n", fmt::join(intrinsics, ", "))
         << "distortion_model: radial-tangential\n"
         << fmt::format("distortion_coefficients: [{}] # k1, k2, p1, p2\n", fmt::join(distortion, ", "))
         << fmt::format("T_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\n",
                        fmt::join(T_body_camera.data(), T_body_camera.data() + T_body_camera.size(), ", "))
         << fmt::format("depth_scale: {} # depth image units per metre; 0 = no reading\n",
                        calibration.depth_units_per_metre);
  stream.close();
  if (!stream) return absl::ResourceExhaustedError(fmt::format("{}: cannot be written", file));
  return absl::OkStatus();
}

}  // namespace mapp
