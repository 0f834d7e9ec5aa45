#include "datasets/calibration.h"
#include "datasets/recorded_sequence.h"

#include <fmt/format.h>

#include <filesystem>

namespace mapp {
namespace {

// Colour and depth of one exposure are this close in the TUM data set (its associate.py uses the same bound).
constexpr int64_t kMaxDepthDelayNs = 20'000'000;

/// Frames that have no depth image within the bound are left out.
StatusOr<std::vector<FrameFiles>> PairWithDepth(const std::vector<ListedImage>& color, const std::string& depth_list,
                                                const std::string& folder) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<ListedImage> depth, ReadImageList(depth_list, folder, StampUnit::kSeconds));
  std::vector<FrameFiles> frames;
  for (const ListedImage& image : color) {
    const ListedImage* partner = NearestImage(depth, image.stamp_ns, kMaxDepthDelayNs);
    if (partner != nullptr) frames.push_back({image.stamp_ns, image.file, partner->file, ""});
  }
  if (frames.empty()) {
    return absl::InvalidArgumentError(fmt::format("{}: no depth image within 20 ms of any colour image", depth_list));
  }
  return frames;
}

}  // namespace

StatusOr<SequenceIndex> ReadTumIndex(const std::string& folder) {
  const std::filesystem::path root(folder);
  SequenceIndex index;
  MAPP_ASSIGN_OR_RETURN(const CameraCalibration calibration, ReadCameraCalibration((root / "camera.yaml").string()));
  index.camera = calibration.camera;
  index.depth_units_per_metre = calibration.depth_units_per_metre;
  MAPP_ASSIGN_OR_RETURN(const std::vector<ListedImage> color,
                        ReadImageList((root / "rgb.txt").string(), folder, StampUnit::kSeconds));
  const std::string depth_list = (root / "depth.txt").string();
  std::error_code error;
  if (std::filesystem::exists(depth_list, error)) {
    index.sensor = SensorKind::kRgbd;
    MAPP_ASSIGN_OR_RETURN(index.frames, PairWithDepth(color, depth_list, folder));
  } else {
    for (const ListedImage& image : color) index.frames.push_back({image.stamp_ns, image.file, "", ""});
  }
  MAPP_ASSIGN_OR_RETURN(index.ground_truth, ReadGroundTruth(folder));
  return index;
}

}  // namespace mapp
