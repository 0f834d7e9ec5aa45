#pragma once

#include "sim/texture.h"

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace mapp::sim {

/// The part of a texture that a surface shows: (u, v) of the surface in [0, 1]^2 is the texture's (u0 + u (u1 - u0), v0
/// + v (v1 - v0)). Beyond [0, 1] the texture repeats; u1 < u0 mirrors it.
struct TextureWindow {
  float u0 = 0, v0 = 0, u1 = 1, v1 = 1;
  friend bool operator==(const TextureWindow&, const TextureWindow&) = default;
};

/// How bright a surface is lit: factors on a grid of `columns` x `rows` nodes, the outer ones on the surface's border,
/// row-major, blended linearly; at least 2 x 2. Empty: 1 everywhere.
struct LightGrid {
  int columns = 0;
  int rows = 0;
  std::vector<float> factors;
};

/// A flat rectangle with a picture on its front. Seen from the front, u runs right, v down, and the normal
/// edge_v x edge_u points at the viewer; from behind it is invisible.
struct Quad {
  Eigen::Vector3d corner_world;            ///< of the picture's top left, metres
  Eigen::Vector3d edge_u_world;            ///< along the picture's width, metres; perpendicular to edge_v
  Eigen::Vector3d edge_v_world;            ///< along the picture's height, metres
  std::shared_ptr<const Texture> texture;  ///< shared by surfaces that look alike; never null
  TextureWindow window{};
  LightGrid light{};
  Eigen::Vector3f tint_rgb = Eigen::Vector3f::Ones();  ///< colour; gray images do not show it
  uint32_t object_id = 0;                              ///< of what may come and go; 0: it is part of the surroundings

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

/// What a light of that strength and reach adds to the brightness of a point, `to_light_world` away from it (metres),
/// on a surface of that unit normal: Lambert's law, as strong as at 1 m when nearer, half as strong at `reach_m`.
double UnshadowedLight(double strength, double reach_m, const Eigen::Vector3d& to_light_world,
                       const Eigen::Vector3d& normal_world);

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
