#pragma once

#include "mapp/base/status.h"
#include "sim/paint.h"
#include "sim/texture.h"

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace mapp::sim {

enum class Material {
  kConcrete,
  kMasonry,
  kPlaster,
  kCeiling,
  kAsphalt,
  kPaving,
  kRoof,
  kFacadeA,  ///< to D: bays of one window and one storey
  kFacadeB,
  kFacadeC,
  kFacadeD,
  kShops,
  kDoor,
  kFoliage,
  kMachine,
  kSheetMetal,
  kPlates,
  kPlanks,
  kCarton,
  kPoster,
  kPanes,
  kLadder,
  kStripes,
  kRoadLine,
  kArrow,
  kTube,
  kClothes,
  kGoods,
};

/// A picture and the size it was drawn for.
struct Picture {
  std::shared_ptr<const Texture> texture;
  double width_m = 0;
  double height_m = 0;
};

/// Draws and keeps the pictures of one world, so that surfaces share them. What a material looks like depends on the
/// seed alone, not on who asks first. One thread only.
class Materials {
 public:
  explicit Materials(uint64_t seed) : seed_(seed) {}

  /// Takes the photographs (JPEG, PNG) of a folder, by name, for concrete, masonry and plaster.
  /// NOT_FOUND: no such folder. INVALID_ARGUMENT: no photograph in it. Errors of ReadGrayImage().
  Status PaperWallsWith(const std::string& folder);

  /// The variants of a material, drawn when first asked for; never empty. Throws what OpenCV throws without memory.
  const std::vector<Picture>& Of(Material material);
  /// A plate with a text on it.
  Picture Sign(const std::string& text, double width_m, double height_m);

 private:
  const uint64_t seed_;
  std::map<Material, std::vector<Picture>> drawn_;
  std::vector<Picture> photographs_;
};

/// A picture drawn by `paint`, a function of sim/paint.h's kind bound to its arguments.
template <typename PaintFunction>
Picture Draw(const Canvas& canvas, const PaintFunction& paint) {
  return {std::make_shared<const Texture>(paint(canvas)), canvas.width_m, canvas.height_m};
}

/// Seed of a part of what `seed` stands for, without relation to those of other parts.
uint64_t SeedOf(uint64_t seed, uint64_t part);

}  // namespace mapp::sim
