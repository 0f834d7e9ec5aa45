#include "sim/world/materials.h"

#include "datasets/image_file.h"
#include "mapp/base/rng.h"
#include "sim/paint.h"
#include "sim/world/paint_places.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <future>
#include <system_error>
#include <utility>

namespace mapp::sim {
namespace {

constexpr double kSignTexels_per_m = 220;
/// What a photograph's longer edge shows.
constexpr double kPhotograph_m = 3.2;
constexpr int kMaxPhotographTexels = 1024;

using PaintFunction = GrayImage (*)(const Canvas&, Rng&);

struct Recipe {
  PaintFunction paint = nullptr;
  size_t num_variants = 1;
  Canvas canvas;
};

Recipe RecipeOf(Material material) {
  switch (material) {
    case Material::kConcrete:
      return {PaintConcrete, 6, {4.0, 3.0, 180}};
    case Material::kMasonry:
      return {PaintMasonry, 5, {4.0, 3.0, 180}};
    case Material::kPlaster:
      return {PaintPlaster, 5, {4.0, 3.0, 170}};
    case Material::kCeiling:
      return {PaintConcrete, 5, {4.0, 4.0, 140}};
    case Material::kAsphalt:
      return {PaintAsphalt, 10, {4.0, 4.0, 160}};
    case Material::kPaving:
      return {PaintPaving, 10, {4.0, 4.0, 160}};
    case Material::kRoof:
      return {PaintRoof, 4, {4.0, 4.0, 110}};
    case Material::kFacadeA:
      return {PaintLightBay, 4, {3.0, 3.0, 150}};
    case Material::kFacadeB:
      return {PaintBrickBay, 4, {3.0, 3.0, 150}};
    case Material::kFacadeC:
      return {PaintDarkBay, 4, {3.0, 3.0, 150}};
    case Material::kFacadeD:
      return {PaintPanelBay, 4, {3.0, 3.0, 150}};
    case Material::kShops:
      return {PaintShopFront, 10, {4.0, 3.4, 170}};
    case Material::kDoor:
      return {PaintDoor, 3, {1.1, 2.1, 200}};
    case Material::kFoliage:
      return {PaintFoliage, 3, {2.5, 2.5, 150}};
    case Material::kMachine:
      return {PaintMachinePanel, 10, {2.4, 2.4, 220}};
    case Material::kSheetMetal:
      return {PaintSheetMetal, 4, {4.0, 3.0, 160}};
    case Material::kPlates:
      return {PaintPlates, 6, {3.0, 3.0, 200}};
    case Material::kPlanks:
      return {PaintPlanks, 3, {2.5, 2.5, 200}};
    case Material::kCarton:
      return {PaintCarton, 8, {1.0, 0.8, 250}};
    case Material::kPoster:
      return {PaintPoster, 14, {0.9, 1.2, 250}};
    case Material::kPanes:
      return {PaintPanes, 3, {4.0, 2.5, 120}};
    case Material::kLadder:
      return {PaintLadder, 1, {0.5, 3.0, 180}};
    case Material::kStripes:
      return {PaintStripes, 2, {2.0, 0.4, 160}};
    case Material::kRoadLine:
      return {PaintRoadLine, 4, {5.0, 0.12, 160}};
    case Material::kArrow:
      return {PaintArrow, 2, {3.0, 1.1, 120}};
    case Material::kTube:
      return {PaintTube, 1, {1.5, 0.25, 100}};
    case Material::kClothes:
      return {PaintCloth, 8, {0.6, 0.9, 180}};
    case Material::kGoods:
      return {PaintBooks, 4, {2.0, 2.0, 200}};
  }
  return {};
}

bool IsPhotograph(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending == ".jpg" || ending == ".jpeg" || ending == ".png";
}

/// Made small enough to be one of many.
GrayImage Shrunk(GrayImage image) {
  const int longest = std::max(image.width, image.height);
  if (longest <= kMaxPhotographTexels) return image;
  const double scale = static_cast<double>(kMaxPhotographTexels) / longest;
  GrayImage small(std::max(static_cast<int>(scale * image.width), 1),
                  std::max(static_cast<int>(scale * image.height), 1));
  cv::Mat target(small.height, small.width, CV_8UC1, small.pixels.data());
  cv::resize(cv::Mat(image.height, image.width, CV_8UC1, image.pixels.data()), target, target.size(), 0, 0,
             cv::INTER_AREA);
  return small;
}

}  // namespace

uint64_t SeedOf(uint64_t seed, uint64_t part) {
  Rng rng(seed * 0xd1342543de82ef95ULL + part);
  rng.Next();
  return rng.Next();
}

Status Materials::PaperWallsWith(const std::string& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> files;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (IsPhotograph(it->path())) files.push_back(it->path());
  }
  if (error) return absl::NotFoundError(fmt::format("textures_folder: {}: {}", folder, error.message()));
  if (files.empty()) {
    return absl::InvalidArgumentError(fmt::format("textures_folder: no JPEG or PNG in {}", folder));
  }
  std::ranges::sort(files);
  for (const std::filesystem::path& file : files) {
    MAPP_ASSIGN_OR_RETURN(GrayImage image, ReadGrayImage(file.string()));
    image = Shrunk(std::move(image));
    const double m_per_texel = kPhotograph_m / std::max(image.width, image.height);
    const double width_m = m_per_texel * image.width;
    const double height_m = m_per_texel * image.height;
    photographs_.push_back({std::make_shared<const Texture>(std::move(image)), width_m, height_m});
  }
  return absl::OkStatus();
}

const std::vector<Picture>& Materials::Of(Material material) {
  const bool is_wall =
      material == Material::kConcrete || material == Material::kMasonry || material == Material::kPlaster;
  if (is_wall && !photographs_.empty()) return photographs_;
  std::vector<Picture>& pictures = drawn_[material];
  if (!pictures.empty()) return pictures;
  const Recipe recipe = RecipeOf(material);
  pictures.resize(recipe.num_variants);
  // Every picture has a seed of its own, so threads may share the work.
  const auto draw_every_second = [&](size_t first) {
    for (size_t i = first; i < pictures.size(); i += 2) {
      Rng rng(SeedOf(seed_, 1000 * (1 + static_cast<uint64_t>(material)) + i));
      pictures[i] = Draw(recipe.canvas, [&](const Canvas& canvas) { return recipe.paint(canvas, rng); });
    }
  };
  std::future<void> odd = std::async(std::launch::async, draw_every_second, 1);
  draw_every_second(0);
  odd.get();
  return pictures;
}

Picture Materials::Sign(const std::string& text, double width_m, double height_m) {
  Rng rng(SeedOf(seed_, 7));
  return Draw({width_m, height_m, kSignTexels_per_m},
              [&](const Canvas& canvas) { return PaintSign(canvas, text, rng); });
}

}  // namespace mapp::sim
