#include "cli/session_track.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace mapp {
namespace {

/// Frames of one session by time: a log's frames and the map's keyframes meet at their times.
using FramesByStamp = std::map<int64_t, TrackFrame>;

std::string LabelOf(uint64_t session_id, const std::vector<SessionSummary>& sessions) {
  for (const SessionSummary& session : sessions) {
    if (session.id == session_id) return fmt::format("{}: {}", session_id, session.device);
  }
  return fmt::format("session {}", session_id);
}

}  // namespace

bool SessionTrack::IsContinuous(size_t frame_idx) const {
  // A log has a frame every few tens of milliseconds unless tracking was lost.
  constexpr int64_t kMaxGapNs = 1'000'000'000;
  return !has_every_frame || frames[frame_idx].stamp_ns - frames[frame_idx - 1].stamp_ns <= kMaxGapNs;
}

size_t SessionTrack::CountMarks(FrameMark mark) const {
  return static_cast<size_t>(
      std::count_if(frames.begin(), frames.end(), [mark](const TrackFrame& frame) { return frame.mark == mark; }));
}

std::vector<SessionTrack> MakeTracks(const std::vector<MapFrameSummary>& keyframes, const std::vector<FrameLog>& logs,
                                     const std::vector<SessionSummary>& sessions) {
  std::map<uint64_t, FramesByStamp> frames_by_session;
  std::map<uint64_t, bool> logged;
  for (const FrameLog& log : logs) {
    logged[log.session_id] = true;
    for (const LoggedFrame& frame : log.frames) {
      const FrameMark mark = frame.role == FrameRole::kSharedKeyframe ? FrameMark::kShared : FrameMark::kNone;
      frames_by_session[log.session_id][frame.stamp_ns] = {frame.stamp_ns, frame.T_map_camera, mark,
                                                           frame.on_shared_map};
    }
  }
  for (const MapFrameSummary& keyframe : keyframes) {
    TrackFrame& frame = frames_by_session[keyframe.session_id][keyframe.stamp_ns];
    frame.stamp_ns = keyframe.stamp_ns;
    frame.T_map_camera = keyframe.T_map_camera;
    frame.mark = keyframe.partial ? FrameMark::kPartial : FrameMark::kWhole;
  }
  std::vector<SessionTrack> tracks;
  for (const auto& [session_id, frames] : frames_by_session) {
    SessionTrack track{session_id, LabelOf(session_id, sessions), logged[session_id], {}};
    for (const auto& [stamp_ns, frame] : frames) track.frames.push_back(frame);
    tracks.push_back(std::move(track));
  }
  return tracks;
}

}  // namespace mapp
