#include "storage/memory/diff.h"

#include <map>

namespace mapp::memory {
namespace {

bool IsSame(const Pose3& a, const Pose3& b) {
  return a.translation() == b.translation() && a.rotation().coeffs() == b.rotation().coeffs();
}

class DiffBySession {
 public:
  SessionDiff& operator[](SessionId session) {
    SessionDiff& diff = diffs_[session];
    diff.session = session;
    return diff;
  }
  std::vector<SessionDiff> List() const {
    std::vector<SessionDiff> list;
    for (const auto& [session, diff] : diffs_) list.push_back(diff);
    return list;
  }

 private:
  std::map<SessionId, SessionDiff> diffs_;
};

/// Frames stay: those of `before` are in `after`.
void AddFrames(const MapState& before, const MapState& after, DiffBySession* diffs) {
  after.frames.ForEach([&](FrameId id, const StoredFrame& frame) {
    const StoredFrame* const old = before.frames.Find(id);
    const bool was = old != nullptr && old->record.in_map;
    const bool is = frame.record.in_map;
    if (!was && is) ++(*diffs)[frame.record.session].frames_added;
    if (was && !is) ++(*diffs)[frame.record.session].frames_removed;
    if (was && is && !IsSame(old->record.T_frame_camera, frame.record.T_frame_camera)) {
      ++(*diffs)[frame.record.session].frames_moved;
    }
  });
}

void AddPoints(const MapState& before, const MapState& after, DiffBySession* diffs) {
  after.points.ForEach([&](MapPointId id, const PointRecord& point) {
    if (!point.in_map) return;
    const PointRecord* const old = before.points.Find(id);
    const bool was = old != nullptr && old->in_map;
    if (!was) ++(*diffs)[point.session].points_added;
    if (was && old->position != point.position) ++(*diffs)[point.session].points_moved;
  });
  before.points.ForEach([&](MapPointId id, const PointRecord& old) {
    if (!old.in_map) return;
    const PointRecord* const point = after.points.Find(id);
    if (point == nullptr || !point->in_map) ++(*diffs)[old.session].points_removed;
  });
}

}  // namespace

std::vector<SessionDiff> Diff(const MapState& before, const MapState& after) {
  DiffBySession diffs;
  AddFrames(before, after, &diffs);
  AddPoints(before, after, &diffs);
  return diffs.List();
}

}  // namespace mapp::memory
