#pragma once

#include "sim/texture.h"

#include <Eigen/Core>

#include <functional>
#include <vector>

namespace mapp::sim {

/// A flat rectangle with a picture on its front. Seen from the front, u runs right, v down, and the normal
/// edge_v x edge_u points at the viewer; from behind it is invisible.
struct Quad {
  Eigen::Vector3d corner_world;  ///< of the picture's top left, metres
  Eigen::Vector3d edge_u_world;  ///< along the picture's width, metres; perpendicular to edge_v
  Eigen::Vector3d edge_v_world;  ///< along the picture's height, metres
  Texture texture;

  Eigen::Vector3d NormalWorld() const { return edge_v_world.cross(edge_u_world).normalized(); }
};

/// Everything a renderer shows. Immutable once built.
struct Scene {
  std::vector<Quad> quads;
};

/// Draws the picture of a surface of `width_m` x `height_m`.
using Painter = std::function<GrayImage(double width_m, double height_m)>;

/// A lamp without size: gray levels are multiplied by ambient + Lambert's law, the same from every side, so that a
/// surface looks equal in all views. Baked into the textures.
struct Lamp {
  Eigen::Vector3d p_world;
  double ambient = 0.55;
  double strength = 0.75;  ///< at 1 m and below, facing the lamp
  double reach_m = 4.0;    ///< where its light has fallen to half
};

/// Adds a rectangle; see Quad for the frame of its corner and edges.
void AddQuad(const Eigen::Vector3d& corner_world, const Eigen::Vector3d& edge_u_world,
             const Eigen::Vector3d& edge_v_world, const Painter& paint, const Lamp& lamp, Scene& scene);

/// Adds the outside of an upright box (z is up) turned by `yaw` (radians, about z) around its centre: four sides and
/// the top, and the bottom if it stands clear of the floor (z = 0).
struct BoxShape {
  Eigen::Vector3d center_world;
  Eigen::Vector3d size_m;
  double yaw = 0;
};
void AddBox(const BoxShape& box, const Painter& paint, const Lamp& lamp, Scene& scene);

}  // namespace mapp::sim
