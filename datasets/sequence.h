#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

struct StampedPose {
  int64_t stamp_ns = 0;
  Pose3 T_world_camera;  ///< or another pair of frames, as the holder says
};

struct SequenceFrame {
  int64_t stamp_ns = 0;
  GrayImage gray;
  DepthImage depth_m;    ///< RGB-D only
  GrayImage right_gray;  ///< stereo only
};

/// A recorded (or simulated) sequence, frames read from disk one by one.
class Sequence {
 public:
  virtual ~Sequence() = default;
  virtual const std::string& name() const = 0;  ///< the folder's
  virtual SensorKind sensor() const = 0;
  virtual const Camera& camera() const = 0;  ///< left or colour camera, as recorded
  /// Stereo: the right camera and its pose in the left camera's frame.
  virtual const std::optional<Camera>& right_camera() const = 0;
  virtual const Pose3& T_left_right() const = 0;
  virtual size_t num_frames() const = 0;
  virtual int64_t stamp_ns(size_t frame_idx) const = 0;
  /// NOT_FOUND or DATA_LOSS naming the file for a missing or broken image.
  virtual StatusOr<SequenceFrame> Read(size_t frame_idx) const = 0;
  /// T_world_camera; empty without ground truth.
  virtual const std::vector<StampedPose>& ground_truth() const = 0;
};

/// Opens a folder: TUM RGB-D (`rgb.txt`, `depth.txt` if RGB-D, `camera.yaml`) or EuRoC ASL (`mav0/cam0`, perhaps
/// `mav0/cam1`), each with an optional `groundtruth.txt`. Images go by the names in the lists (PNG or JPEG).
/// NOT_FOUND: no folder, or neither layout. INVALID_ARGUMENT: a list or calibration that does not parse (file and
/// line named), or no images in it.
StatusOr<std::unique_ptr<Sequence>> OpenSequence(const std::string& folder);

/// TUM trajectory: `t tx ty tz qx qy qz qw`, seconds and metres, `#` begins a comment.
StatusOr<std::vector<StampedPose>> ReadTumTrajectory(const std::string& file);
Status WriteTumTrajectory(const std::string& file, const std::vector<StampedPose>& poses);

}  // namespace mapp
