#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"

#include <memory>

namespace mapp {

struct OdometryMapperOptions {
  /// Half the window in which points are looked for around where the odometry puts them, pixels at octave 0: three
  /// times what one step's error of 1 cm does to a point at 1.5 m.
  double search_radius_px = 10;
  /// Depths beyond are not made into points; 0: 40 baselines. Further than a room is wide: a bound that cuts through
  /// what is seen keeps the points that were measured too near and leaves out those measured too far.
  double max_depth_m = 12;
};

/// A foreign SLAM system at the keyframe level, as one that takes part through `Participant`: it is given the stereo
/// images of keyframes and their poses from an odometry, finds features and depths, and follows points from keyframe to
/// keyframe. It never corrects a pose: what the odometry drifts is left to the server. One thread.
class OdometryMapper {
 public:
  /// INVALID_ARGUMENT for a sequence that is not stereo, or cameras that cannot be rectified.
  static StatusOr<std::unique_ptr<OdometryMapper>> Create(const Sequence& sequence,
                                                          const OdometryMapperOptions& options);
  ~OdometryMapper();

  /// The rectified left camera, which poses and keyframes refer to.
  const Camera& camera() const;
  /// Its pose in the recorded left camera's frame (a rotation).
  const Pose3& T_left_camera() const;

  /// Makes the next keyframe, whole: numbered from 0, a session point where a feature shows one. INVALID_ARGUMENT for
  /// images that are missing or of another size than the camera's.
  StatusOr<Keyframe> Add(const SequenceFrame& images, const Pose3& T_session_camera);

 private:
  struct Impl;
  explicit OdometryMapper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
