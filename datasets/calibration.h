#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <string>

namespace mapp {

/// What a camera.yaml or an EuRoC sensor.yaml says. docs/formats/sequence.md lists the keys.
struct CameraCalibration {
  Camera camera;
  Pose3 T_body_camera;               ///< key T_BS; identity without it
  double depth_units_per_metre = 0;  ///< key depth_scale; the TUM data set's 5000 without it
};

/// NOT_FOUND: no such file. INVALID_ARGUMENT "file: key: problem" (or "file(line)"): it does not parse, a key is
/// missing or no number, or a value is out of the range that Camera::Validate() accepts.
StatusOr<CameraCalibration> ReadCameraCalibration(const std::string& file);

/// Writes a pinhole or radial-tangential camera with the same keys. RESOURCE_EXHAUSTED when it cannot be written.
Status WriteCameraCalibration(const std::string& file, const CameraCalibration& calibration, double rate_hz);

}  // namespace mapp
