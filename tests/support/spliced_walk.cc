#include "tests/support/spliced_walk.h"

#include "mapp/base/check.h"
#include "sim/room.h"

#include <map>
#include <string>
#include <utility>

namespace mapp {
namespace {

constexpr int64_t kFrameNs = 1'000'000'000 / 15;

class SplicedWalk final : public Sequence {
 public:
  explicit SplicedWalk(const std::vector<RoomStretch>& stretches) {
    for (const RoomStretch& stretch : stretches) {
      auto& room = rooms_[stretch.session];
      if (room == nullptr) {
        sim::RoomOptions options;
        options.session = stretch.session;
        auto drawn = sim::MakeRoomSequence(options);
        MAPP_CHECK(drawn.ok());
        room = *std::move(drawn);
      }
      for (size_t i = 0; i < stretch.num_frames(); ++i) {
        const size_t frame_idx = stretch.first < stretch.last ? stretch.first + i : stretch.first - i;
        const int64_t stamp_ns = kFrameNs * static_cast<int64_t>(frames_.size() + 1);
        truth_.push_back({stamp_ns, room->ground_truth()[frame_idx].T_world_camera});
        frames_.push_back({room.get(), frame_idx});
      }
    }
    MAPP_CHECK(!frames_.empty());
  }

  const std::string& name() const override { return name_; }
  SensorKind sensor() const override { return SensorKind::kRgbd; }
  const Camera& camera() const override { return frames_.front().room->camera(); }
  const std::optional<Camera>& right_camera() const override { return frames_.front().room->right_camera(); }
  const Pose3& T_left_right() const override { return frames_.front().room->T_left_right(); }
  size_t num_frames() const override { return frames_.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return truth_.at(frame_idx).stamp_ns; }
  StatusOr<SequenceFrame> Read(size_t frame_idx) const override {
    const Source& source = frames_.at(frame_idx);
    MAPP_ASSIGN_OR_RETURN(SequenceFrame frame, source.room->Read(source.frame_idx));
    frame.stamp_ns = stamp_ns(frame_idx);
    return frame;
  }
  const std::vector<StampedPose>& ground_truth() const override { return truth_; }

 private:
  struct Source {
    const Sequence* room = nullptr;
    size_t frame_idx = 0;
  };

  const std::string name_ = "spliced walk";
  std::map<int, std::unique_ptr<Sequence>> rooms_;  // by session
  std::vector<Source> frames_;
  std::vector<StampedPose> truth_;
};

}  // namespace

std::unique_ptr<Sequence> MakeSplicedWalk(const std::vector<RoomStretch>& stretches) {
  return std::make_unique<SplicedWalk>(stretches);
}

}  // namespace mapp
