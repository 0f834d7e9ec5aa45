#include "sim/world/camera_rig.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

namespace mapp::sim {
namespace {

constexpr double kStereoBaseline_m = 0.11;

struct CameraRow {
  const char* name;
  int width_px, height_px;
  double k1, k2;
  double fx, fy, cx, cy;
  double exposure_s;
  bool on_drone;
};

// Paper, table "Data collection camera parameter settings". EuRoC's exposure is automatic there: 4 ms is what a hall
// takes. The city's camera has no exposure time.
constexpr std::array<CameraRow, 5> kCameraTable = {{
    {"d455-1280", 1280, 720, -0.046, 0.032, 634.2, 634.8, 631.8, 359.5, 80e-6, false},
    {"d455-848", 848, 480, -0.044, 0.034, 423.7, 423.0, 419.6, 239.7, 120e-6, false},
    {"d455-640", 640, 480, -0.046, 0.038, 383.4, 383.7, 316.5, 239.6, 120e-6, false},
    {"euroc", 752, 480, -0.283, 0.074, 458.7, 457.3, 367.2, 248.4, 4e-3, true},
    {"city", 752, 480, 0, 0, 455.0, 455.0, 376.0, 240.0, 0, true},
}};

Camera MakeCamera(const CameraRow& row) {
  Camera camera;
  if (row.k1 == 0 && row.k2 == 0) {
    camera.projection = PinholeCamera{row.fx, row.fy, row.cx, row.cy};
  } else {
    camera.projection = RadialTangentialCamera{row.fx, row.fy, row.cx, row.cy, row.k1, row.k2, 0, 0};
  }
  camera.width_px = row.width_px;
  camera.height_px = row.height_px;
  return camera;
}

/// Where the camera sits on the IMU. Drones carry EuRoC's sensor (its cam0/sensor.yaml), people a D455.
Pose3 BodyPose(const CameraRow& row) {
  if (!row.on_drone) return Pose3(Eigen::Quaterniond::Identity(), {0.0302, -0.0074, -0.0160});
  Eigen::Matrix4d T_body_camera;
  T_body_camera << 0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,  //
      0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,                   //
      -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,               //
      0, 0, 0, 1;
  return Pose3::FromMatrix(T_body_camera);
}

}  // namespace

const std::vector<std::string>& CameraNames() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const CameraRow& row : kCameraTable) names.emplace_back(row.name);
    return names;
  }();
  return kNames;
}

StatusOr<CameraRig> MakeRig(const std::string& camera_name, SensorKind sensor) {
  const auto row = std::ranges::find_if(kCameraTable, [&](const CameraRow& r) { return camera_name == r.name; });
  if (row == kCameraTable.end()) {
    return absl::InvalidArgumentError(
        fmt::format("camera: '{}' is none of {}", camera_name, fmt::join(CameraNames(), ", ")));
  }
  CameraRig rig;
  rig.name = row->name;
  rig.sensor = sensor;
  rig.camera = MakeCamera(*row);
  rig.T_body_camera = BodyPose(*row);
  rig.exposure_s = row->exposure_s;
  if (sensor == SensorKind::kStereo) {
    rig.camera.stereo_baseline_m = kStereoBaseline_m;
    rig.right_camera = rig.camera;
    rig.T_left_right = Pose3(Eigen::Quaterniond::Identity(), {kStereoBaseline_m, 0, 0});
  }
  return rig;
}

}  // namespace mapp::sim
