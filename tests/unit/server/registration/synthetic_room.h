#pragma once

#include "mapp/base/rng.h"
#include "mapp/map/keyframe.h"

#include <vector>

namespace mapp::testing {

/// What a device's sensors add to the truth.
struct ViewNoise {
  double pixel_px = 0.4;       ///< one sigma
  double depth_share = 0.005;  ///< one sigma, of the depth
  double bit_flip = 0.04;      ///< probability per descriptor bit
};

/// A room of 6 x 3 x 5 m (x, y down, z) around the origin, its walls covered with landmarks of random descriptors.
class SyntheticRoom {
 public:
  /// Rooms of different seeds have nothing in common.
  explicit SyntheticRoom(uint64_t seed);
  /// A room of its own, but for the part x > `panel_from_m` of its +z wall, which is that of `twin`: an equal panel.
  SyntheticRoom(uint64_t seed, const SyntheticRoom& twin, double panel_from_m = 0.4);

  static Camera DeviceCamera();
  /// Upright camera at (x, 0, z) looking along the horizontal direction `heading` radians from +z towards +x.
  static Pose3 Stand(double x, double z, double heading);
  /// Poses on a circle of `radius_m`, looking outwards, `first` and `step` as angles in radians.
  static std::vector<Pose3> Circle(double radius_m, double first, double step, int count);

  /// What a camera at `T_world_camera` sees; its pose is told in a session frame that stands at `T_world_session`.
  /// Landmark numbers serve as the session's point numbers.
  Keyframe View(const Pose3& T_world_camera, const Pose3& T_world_session, SessionId session, uint32_t number,
                const ViewNoise& noise, Rng& rng) const;

 private:
  struct Landmark {
    Eigen::Vector3d p_world;
    Eigen::Vector3d normal;
    float reference_distance_m;
    float angle;
    OrbDescriptor descriptor;
  };

  std::vector<Landmark> landmarks_;
};

}  // namespace mapp::testing
