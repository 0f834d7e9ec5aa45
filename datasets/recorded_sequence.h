#pragma once

#include "datasets/sequence.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// One image of a list: its time and its file.
struct ListedImage {
  int64_t stamp_ns = 0;
  std::string file;
};

struct FrameFiles {
  int64_t stamp_ns = 0;
  std::string gray;
  std::string depth;  ///< empty unless RGB-D
  std::string right;  ///< empty unless stereo
};

/// What the reader of a layout found out; all of a RecordedSequence but the images.
struct SequenceIndex {
  std::string name;
  SensorKind sensor = SensorKind::kMono;
  Camera camera;
  std::optional<Camera> right_camera;
  Pose3 T_left_right;
  double depth_units_per_metre = 0;
  std::vector<FrameFiles> frames;
  std::vector<StampedPose> ground_truth;
};

/// The index of a folder with `rgb.txt`, or with `mav0/cam0`. Errors as OpenSequence().
StatusOr<SequenceIndex> ReadTumIndex(const std::string& folder);
StatusOr<SequenceIndex> ReadEurocIndex(const std::string& folder);

/// Reads a list of images whose files stand below `image_folder`; times must increase.
/// INVALID_ARGUMENT "list:line": a line that does not parse, or no image at all. NOT_FOUND: a listed file is missing.
enum class StampUnit { kSeconds, kNanoseconds };
StatusOr<std::vector<ListedImage>> ReadImageList(const std::string& list, const std::string& image_folder,
                                                 StampUnit unit);

/// The image of `images` (by increasing time) nearest to `stamp_ns`; nullptr if none is within `max_difference_ns`.
const ListedImage* NearestImage(const std::vector<ListedImage>& images, int64_t stamp_ns, int64_t max_difference_ns);

/// `groundtruth.txt` of the folder; empty without that file.
StatusOr<std::vector<StampedPose>> ReadGroundTruth(const std::string& folder);

/// Frames read from disk when asked for. Thread-safe: nothing changes after construction.
class RecordedSequence final : public Sequence {
 public:
  explicit RecordedSequence(SequenceIndex index) : index_(std::move(index)) {}

  const std::string& name() const override { return index_.name; }
  SensorKind sensor() const override { return index_.sensor; }
  const Camera& camera() const override { return index_.camera; }
  const std::optional<Camera>& right_camera() const override { return index_.right_camera; }
  const Pose3& T_left_right() const override { return index_.T_left_right; }
  size_t num_frames() const override { return index_.frames.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return index_.frames.at(frame_idx).stamp_ns; }
  StatusOr<SequenceFrame> Read(size_t frame_idx) const override;
  const std::vector<StampedPose>& ground_truth() const override { return index_.ground_truth; }

 private:
  const SequenceIndex index_;
};

}  // namespace mapp
