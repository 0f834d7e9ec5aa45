#pragma once

#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"
#include "storage/records.h"

#include <span>

namespace mapp {

/// Point of `feature` rebuilt from its ray and depth, in the frame of `T_frame_camera` (DESIGN 4).
Eigen::Vector3d RebuildPoint(const Camera& camera, const Pose3& T_frame_camera, const Keypoint& keypoint,
                             double depth_m);

/// How a frame sees a point.
struct Sighting {
  FrameId frame;
  Eigen::Vector3d camera_center;  ///< in the point's frame, metres
  double focal_px = kReferenceFocalPx;
  uint8_t octave = 0;
};

/// A new point's statistics from its first observation: direction, reference distance, observers.
void InitPointStats(PointRecord& point, const Sighting& sighting, const OrbDescriptor& descriptor,
                    uint32_t num_observations);

/// Folds one more observation into them: running mean direction, reference distance, observer list kept to those that
/// differ most in direction. `observer_centers` are the centres of the present point.observers, same order and frame.
void AddObservation(PointRecord& point, const Sighting& sighting, std::span<const Eigen::Vector3d> observer_centers);

/// Takes one back out again, as far as that goes: an observer that the list let go for it does not come back. Exact to
/// float precision for the mean distance, and for the direction when it was the latest.
void RemoveObservation(PointRecord& point, const Sighting& sighting);

}  // namespace mapp
