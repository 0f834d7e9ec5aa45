#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <optional>
#include <string>
#include <vector>

namespace mapp::sim {

/// The cameras and the IMU of one device. The body frame is the IMU's.
struct CameraRig {
  std::string name;  ///< as CameraNames() lists it
  SensorKind sensor = SensorKind::kRgbd;
  Camera camera;                       ///< left or colour
  std::optional<Camera> right_camera;  ///< stereo only
  Pose3 T_left_right;                  ///< stereo only
  Pose3 T_body_camera;                 ///< of `camera`
  double rate_hz = 20;                 ///< images a second
  double exposure_s = 0;               ///< of one image
  double imu_rate_hz = 200;
};

/// The five rows of the paper's camera table: "d455-1280", "d455-848", "d455-640", "euroc", "city".
const std::vector<std::string>& CameraNames();

/// A device with that camera. Stereo gets a second, equal camera 0.11 m to the right (EuRoC's baseline).
/// INVALID_ARGUMENT: an unknown name, naming those that there are.
StatusOr<CameraRig> MakeRig(const std::string& camera_name, SensorKind sensor);

}  // namespace mapp::sim
