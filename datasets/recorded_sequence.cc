#include "datasets/recorded_sequence.h"

#include "datasets/image_file.h"
#include "datasets/table_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace mapp {
namespace {

template <typename T>
Status CheckSize(const std::string& file, const Image<T>& image, const Camera& camera) {
  if (image.width == camera.width_px && image.height == camera.height_px) return absl::OkStatus();
  return absl::DataLossError(fmt::format("{}: image of {}x{} pixels, the calibration says {}x{}", file, image.width,
                                         image.height, camera.width_px, camera.height_px));
}

StatusOr<GrayImage> ReadGray(const std::string& file, const Camera& camera) {
  MAPP_ASSIGN_OR_RETURN(GrayImage image, ReadGrayImage(file));
  MAPP_RETURN_IF_ERROR(CheckSize(file, image, camera));
  return image;
}

}  // namespace

StatusOr<std::vector<ListedImage>> ReadImageList(const std::string& list, const std::string& image_folder,
                                                 StampUnit unit) {
  const bool in_seconds = unit == StampUnit::kSeconds;
  MAPP_ASSIGN_OR_RETURN(const std::vector<TableRow> rows, ReadTable(list, in_seconds ? ' ' : ',', 2));
  std::vector<ListedImage> images;
  images.reserve(rows.size());
  for (const TableRow& row : rows) {
    const std::string& time = row.fields[0];
    const std::optional<int64_t> stamp_ns = in_seconds ? ParseSeconds(time) : ParseNanoseconds(time);
    if (!stamp_ns) {
      return BadLine(list, row.line,
                     fmt::format("'{}' is not a time in {}", time, in_seconds ? "seconds" : "nanoseconds"));
    }
    if (!images.empty() && *stamp_ns <= images.back().stamp_ns) return BadLine(list, row.line, "times must increase");
    const std::string file = (std::filesystem::path(image_folder) / row.fields[1]).string();
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error)) {
      return absl::NotFoundError(fmt::format("{}:{}: no such file: {}", list, row.line, file));
    }
    images.push_back({*stamp_ns, file});
  }
  if (images.empty()) return absl::InvalidArgumentError(fmt::format("{}: no images in it", list));
  return images;
}

const ListedImage* NearestImage(const std::vector<ListedImage>& images, int64_t stamp_ns, int64_t max_difference_ns) {
  const auto after = std::ranges::lower_bound(images, stamp_ns, {}, &ListedImage::stamp_ns);
  const ListedImage* nearest = nullptr;
  int64_t nearest_ns = max_difference_ns;
  for (auto it = after == images.begin() ? after : after - 1; it != images.end() && it <= after; ++it) {
    const int64_t difference_ns = std::abs(it->stamp_ns - stamp_ns);
    if (difference_ns > nearest_ns) continue;
    nearest = &*it;
    nearest_ns = difference_ns;
  }
  return nearest;
}

StatusOr<std::vector<StampedPose>> ReadGroundTruth(const std::string& folder) {
  const std::string file = (std::filesystem::path(folder) / "groundtruth.txt").string();
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return std::vector<StampedPose>{};
  return ReadTumTrajectory(file);
}

StatusOr<SequenceFrame> RecordedSequence::Read(size_t frame_idx) const {
  if (frame_idx >= num_frames()) {
    return absl::OutOfRangeError(fmt::format("{}: frame {} of {}", name(), frame_idx, num_frames()));
  }
  const FrameFiles& files = index_.frames[frame_idx];
  SequenceFrame frame;
  frame.stamp_ns = files.stamp_ns;
  MAPP_ASSIGN_OR_RETURN(frame.gray, ReadGray(files.gray, index_.camera));
  if (!files.depth.empty()) {
    MAPP_ASSIGN_OR_RETURN(frame.depth_m, ReadDepthImage(files.depth, index_.depth_units_per_metre));
    MAPP_RETURN_IF_ERROR(CheckSize(files.depth, frame.depth_m, index_.camera));
  }
  if (index_.right_camera) {
    MAPP_ASSIGN_OR_RETURN(frame.right_gray, ReadGray(files.right, *index_.right_camera));
  }
  return frame;
}

}  // namespace mapp
