#pragma once

#include "mapp/base/rng.h"
#include "mapp/geometry/pose3.h"
#include "sim/scene.h"
#include "sim/world/materials.h"

#include <Eigen/Core>

#include <span>
#include <vector>

namespace mapp::sim {

/// Where a surface is; as Quad's fields of these names.
struct Rect {
  Eigen::Vector3d corner;
  Eigen::Vector3d edge_u;
  Eigen::Vector3d edge_v;
};

/// An upright rectangle from `left` to `right` as seen from its front (their z is its lower edge), `height_m` high.
Rect UprightRect(const Eigen::Vector3d& left, const Eigen::Vector3d& right, double height_m);
/// Level rectangles over [min.x, max.x] x [min.y, max.y] at min.z, seen from above or below.
Rect FloorRect(const Eigen::Vector3d& min, const Eigen::Vector3d& max);
Rect CeilingRect(const Eigen::Vector3d& min, const Eigen::Vector3d& max);

/// How a box looks. Faces between are all sides.
struct BoxLook {
  Material sides = Material::kPlates;
  Material top = Material::kPlates;
  bool whole_pictures = false;  ///< each side shows a whole picture, stretched, instead of a cut in its true size
  bool with_bottom = false;
};

/// Makes surfaces of materials. What it makes goes to the end of `quads`; choices come from `rng`. All three must
/// outlive it.
class QuadMaker {
 public:
  QuadMaker(Materials& materials, Rng& rng, std::vector<Quad>& quads)
      : materials_(materials), rng_(rng), quads_(quads) {}

  Materials& materials() { return materials_; }
  Rng& rng() { return rng_; }

  /// A whole picture, stretched to the rectangle.
  void Hang(const Rect& rect, const Picture& picture);
  void Hang(const Rect& rect, Material material) { Hang(rect, AnyOf(material)); }
  /// A cut of one variant in its true size, at a place and mirrored by chance; repeats where the rectangle is larger.
  void Cover(const Rect& rect, Material material);
  /// The rectangle in panels of about `panel_m` by `panel_m`, each covered by itself.
  void Panels(const Rect& rect, Material material, double panel_m = 4.0);
  /// Panels of whole pictures, one beside and above another, as facades are.
  void Facade(const Rect& rect, Material material);
  /// An upright box turned by `yaw` about its own axis.
  void Box(const Eigen::Vector3d& center, const Eigen::Vector3d& size_m, double yaw, const BoxLook& look);

  const Picture& AnyOf(Material material);

 private:
  Materials& materials_;
  Rng& rng_;
  std::vector<Quad>& quads_;
};

/// The quads in another frame: T_to_from applied to all.
void AppendTransformed(std::span<const Quad> quads_from, const Pose3& T_to_from, std::vector<Quad>& quads_to);

/// Pose of an upright thing: its origin's place and its turn about z.
Pose3 UprightPose(const Eigen::Vector3d& origin, double yaw);

}  // namespace mapp::sim
