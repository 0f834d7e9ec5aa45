#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "sim/scene.h"

#include <Eigen/Core>

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace mapp::sim {

/// Where a thing stands from a time on, until its next placement.
struct ObjectPlacement {
  int64_t from_ns = std::numeric_limits<int64_t>::min();
  std::optional<Pose3> T_world_object;  ///< absent: it is away
};

/// A thing that may come, go or be moved: a car, a box. Its own frame stands at its box's centre, z up.
struct WorldObject {
  uint32_t id = 0;                          ///< from 1, unique in the world; Quad::object_id of its surfaces
  std::string kind;                         ///< "car", "box", ...
  uint32_t model = 0;                       ///< objects of one kind and model look alike, texel by texel
  Eigen::Vector3d size_m;                   ///< of its oriented box
  std::vector<Quad> quads_object;           ///< surfaces; coordinates in the object's frame
  std::vector<ObjectPlacement> placements;  ///< by increasing time; the first from the beginning of time

  /// T_world_object at a time; absent while away.
  const std::optional<Pose3>& At(int64_t stamp_ns) const;
};

/// A person who walks to and fro, for ever: an obstacle that is never part of the map.
struct Passer {
  std::vector<Quad> quads_object;            ///< frame: on the ground below the body's middle, z up, walking along +x
  std::vector<Eigen::Vector3d> route_world;  ///< at least two points on the ground, walked there and back
  double speed_m_s = 1.2;
  double phase_m = 0;  ///< how far along the way at time 0
};

/// Ways that devices may take: a graph of straight, free pieces. Nodes lie where a camera passes.
struct RouteGraph {
  std::vector<Eigen::Vector3d> nodes_world;      ///< metres
  std::vector<std::pair<size_t, size_t>> edges;  ///< indices of nodes; walked both ways
  double clearance_m = 0.5;                      ///< a device may leave the edges sideways by this without touching
};

/// A sun or lamp; see BakeLights().
struct Light {
  Eigen::Vector3d p_world;
  double strength = 0.75;  ///< added to the brightness of what faces it, unshadowed, at 1 m and below
  double reach_m = 6.0;    ///< where it has fallen to half; infinity for the sun
};

/// A place as it is over time, with all that is known of it: the truth that maps are judged by. World frame: z up,
/// metres. Immutable once made.
struct World {
  std::string setting;  ///< "garage", "plaza", "hall", "city"
  uint64_t seed = 0;
  Aabb bounds_world;   ///< cameras stay inside
  Scene surroundings;  ///< what never changes
  std::vector<WorldObject> objects;
  std::vector<Passer> passers;
  std::vector<Light> lights;
  double ambient = 0.5;  ///< brightness without any light
  uint8_t sky_gray = 0;  ///< where nothing is hit
  RouteGraph routes;
};

/// Something that happens to an object.
enum class ChangeKind { kAppeared, kVanished, kMoved };
struct WorldChange {
  int64_t stamp_ns = 0;
  uint32_t object_id = 0;
  ChangeKind kind = ChangeKind::kVanished;
  std::optional<Pose3> T_world_object_before;  ///< absent when it appeared
  std::optional<Pose3> T_world_object_after;   ///< absent when it vanished
};

/// All changes of the world by increasing time.
std::vector<WorldChange> ChangesOf(const World& world);
/// The surroundings and all objects present at a time, in the world's frame; people are not part of it. Not lit.
Scene SceneAt(const World& world, int64_t stamp_ns);
/// The surfaces of the people at a time, in the world's frame, not lit.
std::vector<Quad> PassersAt(const World& world, int64_t stamp_ns);

/// The settings that MakeWorld() knows.
const std::vector<std::string>& SettingNames();

struct WorldOptions {
  std::string setting = "garage";
  uint64_t seed = 1;
  int num_changes = 0;  ///< objects that leave, come or are moved, shared out evenly in time
  /// Times between which the changes happen; changes fall between visits, never inside [start, end) of one.
  std::vector<std::pair<int64_t, int64_t>> visits_ns;
  int num_stable_visits = 0;  ///< nothing changes before the end of so many visits
  /// What may happen; empty: everything.
  std::vector<ChangeKind> change_kinds;
  /// Only things and places within `change_reach_m` of these points change; empty: all may.
  std::vector<Eigen::Vector3d> change_near_world;
  double change_reach_m = 0;
  int num_passers = 0;
  std::string textures_folder;  ///< photographs (JPEG, PNG) that paper the walls; empty: all is drawn
  /// Space that must stay free, such as given flights: nothing is put within `clearance_m` of these points.
  std::vector<Eigen::Vector3d> keep_free_world;
  double clearance_m = 0.8;
};

/// INVALID_ARGUMENT naming the option: an unknown setting, a number out of range, no photograph in the folder, more
/// changes than there are things that can change. NOT_FOUND: no such folder.
StatusOr<std::shared_ptr<const World>> MakeWorld(const WorldOptions& options);

}  // namespace mapp::sim
