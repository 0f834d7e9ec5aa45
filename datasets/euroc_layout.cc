#include "datasets/calibration.h"
#include "datasets/recorded_sequence.h"

#include <fmt/format.h>

#include <filesystem>

namespace mapp {
namespace {

namespace fs = std::filesystem;

// The two cameras are triggered together; anything further apart is another exposure.
constexpr int64_t kMaxStereoDelayNs = 1'000'000;

struct EurocCamera {
  CameraCalibration calibration;
  std::vector<ListedImage> images;
};

StatusOr<EurocCamera> ReadEurocCamera(const fs::path& folder) {
  EurocCamera camera;
  MAPP_ASSIGN_OR_RETURN(camera.calibration, ReadCameraCalibration((folder / "sensor.yaml").string()));
  MAPP_ASSIGN_OR_RETURN(camera.images, ReadImageList((folder / "data.csv").string(), (folder / "data").string(),
                                                     StampUnit::kNanoseconds));
  return camera;
}

/// Makes `index` a stereo sequence. Frames that have no right image are left out.
Status AddRightCamera(const EurocCamera& left, const EurocCamera& right, const std::string& right_folder,
                      SequenceIndex& index) {
  const Pose3 T_left_body = left.calibration.T_body_camera.Inverse();
  index.sensor = SensorKind::kStereo;
  index.T_left_right = T_left_body * right.calibration.T_body_camera;
  index.right_camera = right.calibration.camera;
  index.camera.stereo_baseline_m = index.T_left_right.translation().norm();
  index.right_camera->stereo_baseline_m = index.camera.stereo_baseline_m;
  if (index.camera.stereo_baseline_m <= 0) {
    return absl::InvalidArgumentError(
        fmt::format("{}/sensor.yaml: T_BS: no distance to the left camera", right_folder));
  }
  MAPP_RETURN_IF_ERROR(Annotate(index.camera.Validate(), right_folder + "/sensor.yaml"));
  for (const ListedImage& image : left.images) {
    const ListedImage* partner = NearestImage(right.images, image.stamp_ns, kMaxStereoDelayNs);
    if (partner != nullptr) index.frames.push_back({image.stamp_ns, image.file, "", partner->file});
  }
  if (index.frames.empty()) {
    return absl::InvalidArgumentError(fmt::format("{}/data.csv: no image at the time of any left image", right_folder));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<SequenceIndex> ReadEurocIndex(const std::string& folder) {
  const fs::path sensors = fs::path(folder) / "mav0";
  SequenceIndex index;
  MAPP_ASSIGN_OR_RETURN(const EurocCamera left, ReadEurocCamera(sensors / "cam0"));
  index.camera = left.calibration.camera;
  std::error_code error;
  if (fs::is_directory(sensors / "cam1", error)) {
    MAPP_ASSIGN_OR_RETURN(const EurocCamera right, ReadEurocCamera(sensors / "cam1"));
    MAPP_RETURN_IF_ERROR(AddRightCamera(left, right, (sensors / "cam1").string(), index));
  } else {
    const bool has_imu = fs::exists(sensors / "imu0" / "data.csv", error);
    index.sensor = has_imu ? SensorKind::kMonoInertial : SensorKind::kMono;
    for (const ListedImage& image : left.images) index.frames.push_back({image.stamp_ns, image.file, "", ""});
  }
  MAPP_ASSIGN_OR_RETURN(index.ground_truth, ReadGroundTruth(folder));
  return index;
}

}  // namespace mapp
