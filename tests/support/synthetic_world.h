#pragma once

#include "mapp/base/rng.h"
#include "mapp/map/keyframe.h"

#include <cstdint>
#include <vector>

namespace mapp::testing {

/// What a device's sensors add to the truth.
struct SensorNoise {
  double pixel_px = 0.3;       ///< one sigma
  double depth_ratio = 0.003;  ///< one sigma, share of the depth
  double bit_flip = 0.03;      ///< probability per descriptor bit
};

/// A room of 8 x 3 x 8 m around the origin (x, y down, z), its walls covered with landmarks of random descriptors, and
/// a cabinet of 1.4 x 1.8 x 0.6 m that stands 0.9 m before the wall at z = +4 m and hides what is behind it.
class SyntheticWorld {
 public:
  /// Worlds of different seeds have the same walls and nothing else in common.
  explicit SyntheticWorld(uint64_t seed);
  /// The same world after somebody has carried the cabinet away.
  SyntheticWorld WithoutCabinet() const;
  /// The same world after this share of what is on the walls was hung elsewhere on its wall.
  SyntheticWorld Rearranged(double share, uint64_t seed) const;

  /// 640 x 480 pinhole with a field of view of 63 degrees.
  static Camera DeviceCamera();
  /// Upright camera at (x, 0, z), turned by `heading` radians from +z towards +x.
  static Pose3 Stand(double x, double z, double heading);

  /// What a camera sees, whole and in the frame `map`: exact pose, each landmark under its number plus
  /// `first_session_point`, as a device would number its own points.
  Keyframe View(const Pose3& T_world_camera, SessionId session, uint32_t number, Rng& rng,
                uint64_t first_session_point = 1, const SensorNoise& noise = {}) const;

 private:
  struct Landmark {
    Eigen::Vector3d p_world;
    Eigen::Vector3d normal;
    double reference_distance_m = 1;
    float angle = 0;
    OrbDescriptor descriptor;
    bool on_cabinet = false;
  };

  void CoverFace(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_a, const Eigen::Vector3d& edge_b,
                 const Eigen::Vector3d& normal, bool on_cabinet, Rng& rng);
  bool IsVisible(const Landmark& landmark, const Eigen::Vector3d& center) const;

  std::vector<Landmark> landmarks_;
  bool has_cabinet_ = true;
};

/// The keyframe's points in its camera's frame.
std::vector<Eigen::Vector3d> OwnPoints(const Keyframe& keyframe, const Camera& camera);

}  // namespace mapp::testing
